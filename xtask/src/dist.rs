//! Release builds that are the same wherever and whenever they are made: static, for two processors, flight and full.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};

use crate::debian;
use crate::shell::{cargo, program, root, run, target_dir};

/// A processor that is shipped for.
pub(crate) struct Platform {
    /// In Rust's words.
    pub(crate) target: &'static str,
    /// In Debian's.
    pub(crate) architecture: &'static str,
    /// Compiler of the C code.
    compiler: &'static str,
    /// Debian packages with the compiler and its headers, each with a file of it.
    packages: &'static [(&'static str, &'static str)],
    /// What runs its programs on x86-64, with the package that has it; none where they run by themselves.
    pub(crate) emulator: Option<(&'static str, &'static str)>,
}

/// All of them.
pub(crate) const PLATFORMS: [Platform; 2] = [
    Platform {
        target: "x86_64-unknown-linux-musl",
        architecture: "amd64",
        compiler: "musl-gcc",
        packages: &[("musl-tools", "/usr/bin/musl-gcc")],
        emulator: None,
    },
    Platform {
        target: "aarch64-unknown-linux-musl",
        architecture: "arm64",
        compiler: "aarch64-linux-gnu-gcc",
        packages: &[
            ("gcc-aarch64-linux-gnu", "/usr/bin/aarch64-linux-gnu-gcc"),
            ("libc6-dev-arm64-cross", "/usr/aarch64-linux-gnu/include/string.h"),
        ],
        emulator: Some(("qemu-aarch64-static", "qemu-user-static")),
    },
];

/// What is built of the program.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Build {
    /// What the daemon needs.
    Flight,
    /// Every verb.
    Full,
}

impl Build {
    /// Both of them.
    pub(crate) const ALL: [Self; 2] = [Self::Flight, Self::Full];

    /// What is built: on the ground an actuator to try the program with, too.
    fn packages(self) -> &'static [&'static str] {
        match self {
            Self::Flight => &["--package", "hmd"],
            Self::Full => &["--package", "hmd", "--package", "firmware_sim"],
        }
    }

    /// Cargo's options for its features.
    pub(crate) fn features(self) -> &'static [&'static str] {
        match self {
            Self::Flight => &["--no-default-features"],
            Self::Full => &[],
        }
    }
}

/// Makes every build for every platform twice, in different folders and without anything of the first left, and compares.
pub(crate) fn check() -> anyhow::Result<()> {
    for (platform, kind) in PLATFORMS
        .iter()
        .flat_map(|platform| Build::ALL.map(|kind| (platform, kind)))
    {
        let [one, other] = ["dist1", "dist2"].map(|name| build(platform, kind, name));
        let (one, other) = (one?, other?);
        let same = fs::read(&one)? == fs::read(&other)?;
        ensure!(same, "{} and {} differ", one.display(), other.display());
        run(program("sha256sum", [&one, &other]))?;
    }
    Ok(())
}

/// The program for a platform, built in a folder of this name below the target directory; each build replaces the other.
pub(crate) fn build(platform: &Platform, kind: Build, folder: &str) -> anyhow::Result<PathBuf> {
    debian::install(platform.packages)?;
    run(program("rustup", ["target", "add", platform.target]))?;
    let folder = target_dir()?.join(folder);
    let under = platform.target.replace('-', "_");
    let paths = [(root(), "/hmd"), (&cargo_home()?, "/cargo"), (&folder, "/target")];
    let of_paths = |option: &str| -> String {
        let renamed = paths
            .iter()
            .map(|(path, name)| format!("{option}={}={name}", path.display()));
        renamed.collect::<Vec<_>>().join(" ")
    };
    let build = ["build", "--locked", "--profile", "dist", "--target", platform.target];
    run(cargo(build)
        .args(kind.packages())
        .args(kind.features())
        .env("CARGO_TARGET_DIR", &folder)
        .env("RUSTFLAGS", of_paths("--remap-path-prefix"))
        .env("CFLAGS", of_paths("-ffile-prefix-map"))
        .env("SOURCE_DATE_EPOCH", "0")
        .env(format!("CC_{under}"), platform.compiler)
        // The one that comes with the compiler, so that the system's has no say.
        .env(format!("CARGO_TARGET_{}_LINKER", under.to_uppercase()), "rust-lld"))?;
    Ok(folder.join(platform.target).join("dist/hmd"))
}

fn cargo_home() -> anyhow::Result<PathBuf> {
    let home = || std::env::var_os("HOME").map(|home| Path::new(&home).join(".cargo"));
    let given = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    given.or_else(home).context("expected CARGO_HOME or HOME")
}

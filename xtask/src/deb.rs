//! The Debian packages: `cargo-deb` by the metadata in `crates/hmd/Cargo.toml`, with what has to be made first.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use anyhow::{Context, ensure};

use crate::debian;
use crate::dist::{Build, PLATFORMS, Platform, build};
use crate::sbom;
use crate::shell::{cargo, program, root, run, run_to_file, target_dir};
use crate::tools::Tool;

/// What packs.
const CARGO_DEB: Tool = Tool {
    krate: "cargo-deb",
    version: "3.8.0",
    program: "cargo-deb",
    options: &[],
};

/// A package.
struct Package {
    name: &'static str,
    /// Its variant in the metadata.
    variant: &'static [&'static str],
    kind: Build,
    /// What it must contain.
    expected: &'static [&'static str],
}

/// The service.
const SERVICE: Package = Package {
    name: "hmd",
    variant: &["--variant", "flight"],
    kind: Build::Flight,
    expected: &[
        "./usr/lib/hmd/hmd",
        "./usr/lib/systemd/system/hmd.service",
        "./usr/lib/sysusers.d/hmd.conf",
        "./usr/share/hmd/systemd/serial.conf",
        "./etc/hmd/hmd.toml",
        "./usr/share/hmd/ema.dbc",
        "./usr/share/hmd/prometheus/hmd.rules.yml",
        "./usr/share/hmd/grafana/hmd.json",
        "./usr/share/doc/hmd/alerts.md",
        "./usr/share/doc/hmd/sbom.cdx.json",
    ],
};

/// All verbs, for engineers.
const TOOLS: Package = Package {
    name: "hmd-tools",
    variant: &[],
    kind: Build::Full,
    expected: &[
        "./usr/lib/hmd-tools/hmd",
        "./usr/bin/firmware_sim",
        "./usr/share/hmd-tools/ema.dbc",
        "./usr/share/hmd-tools/prometheus/hmd.rules.yml",
        "./usr/share/hmd-tools/grafana/hmd.json",
        "./usr/share/doc/hmd-tools/tutorial.md",
        "./usr/share/bash-completion/completions/hmd",
        "./usr/share/man/man1/hmd.1.gz",
        "./usr/share/man/man1/hmd-run.1.gz",
        "./usr/share/doc/hmd-tools/sbom.cdx.json",
    ],
};

/// Makes both packages for every platform; their programs must replay each golden log with the same bytes.
pub(crate) fn make() -> anyhow::Result<()> {
    let mut replayed: Option<(&str, Vec<(PathBuf, Output)>)> = None;
    for platform in &PLATFORMS {
        run(program("sha256sum", [SERVICE.pack(platform)?]))?;
        let tools = TOOLS.pack(platform)?;
        run(program("sha256sum", [&tools]))?;
        let outputs = replay_golden_logs(platform, &tools)?;
        if let Some((other, expected)) = &replayed {
            let pair = format!("{other} and {}", platform.architecture);
            for ((log, one), (_, other)) in expected.iter().zip(&outputs) {
                ensure!(one == other, "{}: {pair} replay it differently", log.display());
            }
            eprintln!("{pair}: the same bytes of {} golden logs", outputs.len());
        }
        replayed = Some((platform.architecture, outputs));
    }
    Ok(())
}

/// What the program in a package of tools prints of each golden log: unpacked, not installed; emulated where it has to be.
fn replay_golden_logs(platform: &Platform, package: &Path) -> anyhow::Result<Vec<(PathBuf, Output)>> {
    let folder = package.with_extension("");
    let _ = fs::remove_dir_all(&folder);
    run(program("dpkg-deb", ["--extract"]).arg(package).arg(&folder))?;
    let hmd = folder.join("usr/lib/hmd-tools/hmd");
    if let Some((emulator, from)) = platform.emulator {
        debian::install(&[(from, &format!("/usr/bin/{emulator}"))])?;
    }
    let logs = root().join("fixtures/logs");
    let mut outputs = Vec::new();
    for entry in fs::read_dir(&logs).with_context(|| logs.display().to_string())? {
        let log = entry?.path();
        // Beside each log stands what its simulation was given.
        if log.extension().is_some_and(|extension| extension == "jsonl") {
            continue;
        }
        let mut command = match platform.emulator {
            None => program(&hmd, ["replay"]),
            Some((emulator, _)) => program(emulator, [hmd.as_os_str(), "replay".as_ref()]),
        };
        let output = command.arg(&log).arg("--json").output().context("replay")?;
        ensure!(!output.stdout.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
        outputs.push((log, output));
    }
    outputs.sort_by(|(one, _), (other, _)| one.cmp(other));
    ensure!(!outputs.is_empty(), "{}: expected logs", logs.display());
    Ok(outputs)
}

/// Both packages for this kind of computer.
pub(crate) fn native() -> anyhow::Result<[PathBuf; 2]> {
    let native = PLATFORMS
        .iter()
        .find(|platform| platform.target.starts_with(std::env::consts::ARCH))
        .context("expected one of the platforms that packages are made for")?;
    // The full build takes the place of the other, so that each is packed before the next is built.
    Ok([SERVICE.pack(native)?, TOOLS.pack(native)?])
}

impl Package {
    fn pack(&self, platform: &Platform) -> anyhow::Result<PathBuf> {
        let Self {
            name,
            variant,
            kind,
            expected,
        } = *self;
        run(cargo(["build", "--quiet", "--package", "hmd"]))?;
        let hmd = target_dir()?.join("debug/hmd");
        let built = build(platform, kind, "dist1")?;
        let folder = built.with_file_name("package");
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(folder.join("completions")).with_context(|| folder.display().to_string())?;
        // The one that runs here knows the manual.
        run(program(&hmd, ["man"]).arg(folder.join("man")))?;
        // cargo-deb leaves what is built as it is. Without name and date, as Debian asks for.
        run(program("gzip", ["-9", "-n", "-r"]).arg(folder.join("man")))?;
        for shell in ["bash", "zsh", "fish"] {
            let script = folder.join("completions").join(shell);
            run_to_file(program(&hmd, ["completions", shell]), None, &script)?;
        }
        sbom::write(platform.target, kind, &folder.join("sbom.cdx.json"))?;
        let file = format!("{name}_{}_{}.deb", env!("CARGO_PKG_VERSION"), platform.architecture);
        let package = target_dir()?.join("deb").join(file);
        let pack = [
            "--package",
            "hmd",
            "--profile",
            "dist",
            "--no-build",
            "--no-strip",
            "--locked",
        ];
        run(program(CARGO_DEB.path()?, pack)
            .args(["--target", platform.target])
            .args(variant)
            .arg("--output")
            .arg(&package)
            .env("CARGO_TARGET_DIR", target_dir()?.join("dist1"))
            // Dates of the files are not those of the build.
            .env("SOURCE_DATE_EPOCH", "0"))?;
        check(&package, expected)?;
        Ok(package)
    }
}

/// Whether `dpkg-deb` finds in a package what it must contain.
fn check(package: &Path, expected: &[&str]) -> anyhow::Result<()> {
    let listed = program("dpkg-deb", ["--contents"])
        .arg(package)
        .output()
        .context("dpkg-deb")?;
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    for expected in expected {
        let there = listed.lines().any(|line| line.ends_with(&format!(" {expected}")));
        ensure!(there, "{}: expected {expected}", package.display());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the metadata puts from the sources into a package, as its contents are listed.
    fn packed(assets: &toml::Value) -> Vec<String> {
        let mut packed = Vec::new();
        for asset in assets.as_array().into_iter().flatten() {
            let (Some(from), Some(to)) = (asset[0].as_str(), asset[1].as_str()) else {
                continue;
            };
            // What is built has no place among the sources.
            let Some(from) = from.strip_prefix("../../") else {
                continue;
            };
            let (folder, name) = from.rsplit_once('/').unwrap_or(("", from));
            let (start, end) = name.split_once('*').unwrap_or((name, ""));
            let files = fs::read_dir(root().join(folder)).into_iter().flatten().flatten();
            let names = files.filter_map(|file| file.file_name().into_string().ok());
            let names: Vec<String> = names
                .filter(|found| {
                    found == name || (name.contains('*') && found.starts_with(start) && found.ends_with(end))
                })
                .collect();
            assert!(!names.is_empty(), "no {from}");
            packed.extend(names.iter().map(|name| format!("./{to}{name}")));
        }
        packed
    }

    #[test]
    fn what_a_package_must_contain_is_built_or_in_the_sources() {
        let manifest = fs::read_to_string(root().join("crates/hmd/Cargo.toml")).unwrap();
        let manifest: toml::Value = toml::from_str(&manifest).unwrap();
        let deb = &manifest["package"]["metadata"]["deb"];
        for (package, assets) in [(TOOLS, &deb["assets"]), (SERVICE, &deb["variants"]["flight"]["assets"])] {
            let packed = packed(assets);
            let shared = package.expected.iter().filter(|path| {
                let is_built = path.ends_with("sbom.cdx.json") || path.contains("/man/") || path.contains("completion");
                path.contains("/share/") && !is_built
            });
            for path in shared {
                assert!(packed.iter().any(|packed| packed == path), "{path} of {}", package.name);
            }
        }
    }
}

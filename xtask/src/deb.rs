//! The Debian packages: program, unit, users, an example configuration, the DBC file, completions, manual pages and the SBOM.

use std::fs;
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use anyhow::{Context, ensure};

use crate::dist::{PLATFORMS, Platform, build};
use crate::sbom;
use crate::shell::{cargo, program, root, run, target_dir};

/// What is copied as it is: from, to, mode.
const FILES: [(&str, &str, u32); 7] = [
    ("dist/systemd/hmd.service", "usr/lib/systemd/system/hmd.service", 0o644),
    (
        "dist/systemd/variants/serial.conf",
        "usr/share/doc/hmd/examples/serial.conf",
        0o644,
    ),
    (
        "dist/systemd/variants/http.conf",
        "usr/share/doc/hmd/examples/http.conf",
        0o644,
    ),
    (
        "dist/systemd/variants/notify-reload.conf",
        "usr/share/doc/hmd/examples/notify-reload.conf",
        0o644,
    ),
    ("dist/sysusers.d/hmd.conf", "usr/lib/sysusers.d/hmd.conf", 0o644),
    ("fixtures/hmd.toml", "etc/hmd/hmd.toml", 0o644),
    ("fixtures/ema.dbc", "usr/share/hmd/ema.dbc", 0o644),
];

/// Completion scripts: shell, and where it looks.
const COMPLETIONS: [(&str, &str); 3] = [
    ("bash", "usr/share/bash-completion/completions/hmd"),
    ("zsh", "usr/share/zsh/vendor-completions/_hmd"),
    ("fish", "usr/share/fish/vendor_completions.d/hmd.fish"),
];

/// What every package must have; the check of what `dpkg-deb` made.
const EXPECTED: [&str; 8] = [
    "./usr/bin/hmd",
    "./usr/lib/systemd/system/hmd.service",
    "./etc/hmd/hmd.toml",
    "./usr/share/hmd/ema.dbc",
    "./usr/share/bash-completion/completions/hmd",
    "./usr/share/man/man1/hmd.1.gz",
    "./usr/share/man/man1/hmd-run.1.gz",
    "./usr/share/doc/hmd/sbom.cdx.json",
];

/// Makes a package for every platform.
pub(crate) fn make() -> anyhow::Result<()> {
    run(cargo(["build", "--quiet", "--package", "hmd"]))?;
    let hmd = target_dir()?.join("debug/hmd");
    for platform in &PLATFORMS {
        let package = package(platform, &hmd)?;
        run(program("sha256sum", [&package]))?;
    }
    Ok(())
}

/// One package; `hmd` runs here and knows the manual.
fn package(platform: &Platform, hmd: &Path) -> anyhow::Result<PathBuf> {
    let folder = target_dir()?.join("deb").join(platform.architecture);
    let _ = fs::remove_dir_all(&folder);
    put(&folder, "usr/bin/hmd", &fs::read(build(platform, "dist1")?)?, 0o755)?;
    for (from, to, mode) in FILES {
        put(&folder, to, &fs::read(root().join(from)).context(from)?, mode)?;
    }
    for (shell, to) in COMPLETIONS {
        put(&folder, to, &output(hmd, &["completions", shell])?, 0o644)?;
    }
    manual(&folder, hmd)?;
    let changes = fs::read(root().join("CHANGELOG.md"))?;
    put(&folder, "usr/share/doc/hmd/changelog.gz", &gzip(&changes)?, 0o644)?;
    put(&folder, "usr/share/doc/hmd/copyright", COPYRIGHT.as_bytes(), 0o644)?;
    put(&folder, "usr/share/doc/hmd/sbom.cdx.json", b"", 0o644)?;
    sbom::write(platform.target, &folder.join("usr/share/doc/hmd/sbom.cdx.json"))?;

    let version = env!("CARGO_PKG_VERSION");
    let control = format!(
        "Package: hmd\nVersion: {version}\nArchitecture: {}\n{CONTROL}",
        platform.architecture
    );
    put(&folder, "DEBIAN/control", control.as_bytes(), 0o644)?;
    put(&folder, "DEBIAN/conffiles", b"/etc/hmd/hmd.toml\n", 0o644)?;
    put(&folder, "DEBIAN/postinst", POSTINST.as_bytes(), 0o755)?;
    put(&folder, "DEBIAN/prerm", PRERM.as_bytes(), 0o755)?;
    let package = target_dir()?
        .join("deb")
        .join(format!("hmd_{version}_{}.deb", platform.architecture));
    // Dates of the files are not those of the build.
    run(program("dpkg-deb", ["--root-owner-group", "-Zxz", "--build"])
        .args([&folder, &package])
        .env("SOURCE_DATE_EPOCH", "0"))?;
    let listed = program("dpkg-deb", ["--contents"])
        .arg(&package)
        .output()
        .context("dpkg-deb")?;
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    for expected in EXPECTED {
        let there = listed.lines().any(|line| line.ends_with(&format!(" {expected}")));
        ensure!(there, "{}: expected {expected}", package.display());
    }
    Ok(package)
}

/// Pages of the program and of its verbs.
fn manual(folder: &Path, hmd: &Path) -> anyhow::Result<()> {
    let pages = target_dir()?.join("deb/man");
    let _ = fs::remove_dir_all(&pages);
    run(program(hmd, ["man"]).arg(&pages))?;
    for page in fs::read_dir(&pages)? {
        let page = page?;
        let name = page.file_name().to_string_lossy().into_owned();
        let page = gzip(&fs::read(page.path())?)?;
        put(folder, &format!("usr/share/man/man1/{name}.gz"), &page, 0o644)?;
    }
    Ok(())
}

fn put(folder: &Path, to: &str, content: &[u8], mode: u32) -> anyhow::Result<()> {
    let path = folder.join(to);
    fs::create_dir_all(path.parent().unwrap_or(folder)).context(to.to_owned())?;
    fs::write(&path, content).context(to.to_owned())?;
    fs::set_permissions(&path, fs::Permissions::from_mode(mode)).context(to.to_owned())
}

fn output(name: &Path, args: &[&str]) -> anyhow::Result<Vec<u8>> {
    let output = program(name, args)
        .output()
        .with_context(|| name.display().to_string())?;
    ensure!(
        output.status.success(),
        "{} {args:?}: {}",
        name.display(),
        output.status
    );
    Ok(output.stdout)
}

/// Without name and date, as Debian asks for.
fn gzip(content: &[u8]) -> anyhow::Result<Vec<u8>> {
    let mut gzip = program("gzip", ["-9", "-n"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .context("gzip")?;
    let mut input = gzip.stdin.take().context("gzip")?;
    let content = content.to_vec();
    let writer = std::thread::spawn(move || input.write_all(&content));
    let output = gzip.wait_with_output().context("gzip")?;
    ensure!(
        writer.join().is_ok_and(|written| written.is_ok()) && output.status.success(),
        "gzip: {}",
        output.status
    );
    Ok(output.stdout)
}

const CONTROL: &str = "\
Maintainer: hmd <hmd@localhost>
Section: science
Priority: optional
Recommends: systemd
Description: health monitoring of electromechanical actuators
 Identifies wear from phase currents and encoder counts on CAN buses and serial
 lines, and records it.
";

/// The unit is neither enabled nor started: it needs to be told its buses first.
const POSTINST: &str = "\
#!/bin/sh
set -e
if [ \"$1\" = configure ] && [ -d /run/systemd/system ]; then
    systemd-sysusers hmd.conf
    systemctl daemon-reload
    systemctl try-restart hmd.service
fi
";

const PRERM: &str = "\
#!/bin/sh
set -e
if [ \"$1\" = remove ] && [ -d /run/systemd/system ]; then
    systemctl disable --now hmd.service
fi
";

const COPYRIGHT: &str = "\
Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/

Files: *
Copyright: the authors of hmd
License: MIT or Apache-2.0
 Crates that are linked in, with their licences: sbom.cdx.json beside this file.
";

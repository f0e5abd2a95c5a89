//! The Debian packages on a fresh Debian under a real systemd: what `docs/install.md` says, line by line; then started with bad and good
//! files, reloaded, crashed, hung, stopped.
//!
//! Nothing is checked inside: `boot/guest.sh` does it and writes down what systemd says, and this compares.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Stdio;

use anyhow::{Context, bail, ensure};

use crate::shell::{program, run, succeeds, target_dir};
use crate::{deb, debian, guest_state};

/// What it takes, each with a file of it.
const PACKAGES: [(&str, &str); 2] = [
    ("user-mode-linux", "/usr/bin/linux.uml"),
    ("debootstrap", "/usr/sbin/debootstrap"),
];
/// Debian of the guest, and what it has beside the least.
const RELEASE: &str = "bookworm";
const INCLUDED: &str = "systemd,systemd-sysv,kmod,iproute2,can-utils,curl";
const MIRROR: &str = "http://deb.debian.org/debian";

/// Actuations that the guest plays.
const WINDOWS: &str = "6";

/// Longest run of the guest, s.
const LIMIT_S: u32 = 300;

/// What the guest must have written down: `NAME VALUE` on each line.
const EXPECTED: [(&str, &str); 30] = [
    // The page on installing, with a worn actuator on a pseudo-terminal.
    ("page.actuator", "0"),
    ("page.configuration", "0"),
    ("page.service", "0"),
    ("page.look", "0"),
    ("page.end", "0"),
    ("page.journal", "1"),
    ("page.scrape", "1"),
    ("page.report", "1"),
    // A bad file: one start, and no other.
    ("bad.active", "failed"),
    ("bad.status", "78"),
    ("bad.restarts", "0"),
    ("bad.reason", "1"),
    ("good.active", "active"),
    ("good.ready", "1"),
    ("good.enabled", "enabled"),
    // A worn actuator, as its journal tells.
    ("worn.warning", "1"),
    // A bad reload changes nothing.
    ("reload-bad.active", "active"),
    ("reload-bad.same-process", "1"),
    ("reload-bad.reason", "1"),
    ("reload-good.active", "active"),
    ("reload-good.same-process", "1"),
    // Killed by a signal: started again.
    ("crash.active", "active"),
    ("crash.restarts", "1"),
    // Stopped by a signal: the watchdog ends it, and it is started again.
    ("hang.active", "active"),
    ("hang.restarts", "2"),
    ("hang.watchdog", "1"),
    ("stop.active", "inactive"),
    ("stop.result", "success"),
    ("stop.unfinished", "0"),
    // Nothing that the system call filter refused.
    ("denied", "0"),
];

/// Installs, boots, and compares; debootstrap and chroot need root.
pub(crate) fn check() -> anyhow::Result<()> {
    ensure!(
        succeeds(program("sh", ["-c", "test $(id -u) = 0"])),
        "expected to run as root, for debootstrap and chroot"
    );
    debian::install(&PACKAGES)?;
    let packages = deb::native()?;
    let folder = target_dir()?.join("boot");
    fs::create_dir_all(&folder).context("target/boot")?;
    let root = folder.join("root");
    // Of an earlier run everything but what Debian brought.
    let _ = fs::remove_dir_all(&root);
    let base = folder.join(format!("{RELEASE}-{}.tar", INCLUDED.replace(',', "-")));
    if !base.is_file() {
        let mut bootstrap = program("debootstrap", ["--variant=minbase"]);
        bootstrap.arg(format!("--include={INCLUDED}")).arg(RELEASE).arg(&root);
        run(bootstrap.arg(mirror()))?;
        run(program("tar", ["-cf"]).arg(&base).arg("-C").arg(&root).arg("."))?;
    } else {
        fs::create_dir_all(&root)?;
        run(program("tar", ["-xf"]).arg(&base).arg("-C").arg(&root))?;
    }
    let page = root.join("page");
    fs::create_dir_all(&page)?;
    for package in &packages {
        run(program("cp", [package]).arg(&page))?;
    }
    for (name, block) in blocks(include_str!("../../docs/install.md")) {
        fs::write(page.join(name), block)?;
    }
    // Packages are fetched for the guest, which has no network.
    run(program("chroot", [&root]).args(["sh", "-c", "cd /page && . ./install"]))?;
    let modules = root.join("usr/lib/uml");
    fs::create_dir_all(&modules)?;
    run(program("cp", ["-r", "/usr/lib/uml/modules"]).arg(&modules))?;
    prepare(&root)?;
    boot(&root, &folder)?;
    judge(&root)
}

/// The marked blocks of a page, by name.
fn blocks(page: &str) -> impl Iterator<Item = (&str, &str)> {
    page.split("<!-- not run: cargo xtask boot does, as ")
        .skip(1)
        .filter_map(|part| {
            let (name, rest) = part.split_once(" -->")?;
            let (_, block) = rest.split_once("```sh\n")?;
            Some((name, block.split_once("```")?.0))
        })
}

/// Where this computer's own packages come from.
fn mirror() -> String {
    let listed = fs::read_to_string("/etc/apt/sources.list.d/debian.sources").unwrap_or_default();
    let uri = listed.lines().find_map(|line| line.strip_prefix("URIs: "));
    uri.unwrap_or(MIRROR).trim().to_owned()
}

/// The script, and the unit that runs it once the system is up.
fn prepare(root: &Path) -> anyhow::Result<()> {
    let script = root.join("guest.sh");
    fs::write(&script, include_str!("boot/guest.sh"))?;
    fs::set_permissions(&script, fs::Permissions::from_mode(0o755))?;
    let hmd = target_dir()?.join("debug/hmd");
    let worn = [
        "simulate",
        "--rate",
        "400",
        "--fault",
        "backlash=0.4",
        "--windows",
        WINDOWS,
        "-o",
    ];
    run(program(hmd, worn).arg(root.join("worn.log")))?;
    let units = root.join("etc/systemd/system");
    fs::write(
        units.join("guest.service"),
        "[Unit]\nAfter=multi-user.target\n[Service]\nType=oneshot\nExecStart=/guest.sh\nStandardOutput=file:/guest.log\n\
         StandardError=inherit\n",
    )?;
    let wanted = units.join("default.target.wants");
    fs::create_dir_all(&wanted)?;
    std::os::unix::fs::symlink("/etc/systemd/system/guest.service", wanted.join("guest.service"))?;
    Ok(())
}

fn boot(root: &Path, folder: &Path) -> anyhow::Result<()> {
    let console = fs::File::create(folder.join("console.log"))?;
    let limit = ["--kill-after=5".to_owned(), LIMIT_S.to_string()];
    let mut guest = program("timeout", limit);
    guest
        .args([
            "linux.uml",
            "mem=1G",
            "rootfstype=hostfs",
            "rw",
            "init=/lib/systemd/systemd",
        ])
        .args(["con=null", "con0=null,fd:1"])
        .arg(format!("rootflags={}", root.display()))
        .env("LD_PRELOAD", guest_state::library()?)
        .stdin(Stdio::null())
        .stdout(console)
        .stderr(Stdio::null());
    // Its exit code says nothing; what it wrote does.
    guest.status().context("linux.uml").map(|_| ())
}

fn judge(root: &Path) -> anyhow::Result<()> {
    let path = root.join("results");
    let text = fs::read_to_string(&path).unwrap_or_default();
    let found: BTreeMap<&str, &str> = text.lines().filter_map(|line| line.split_once(' ')).collect();
    if !found.contains_key("done") {
        bail!("the guest did not come to its end; it wrote:\n{text}");
    }
    print!("{text}");
    let wrong: Vec<String> = EXPECTED
        .iter()
        .filter(|(name, expected)| found.get(name) != Some(expected))
        .map(|(name, expected)| format!("{name}: expected {expected}, found {:?}", found.get(name)))
        .collect();
    ensure!(
        wrong.is_empty(),
        "{}; see {}",
        wrong.join("; "),
        root.join("journal").display()
    );
    Ok(())
}

//! The user-mode Linux in which SocketCAN is real.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use anyhow::{Context, bail};

use super::between;
use crate::programs::Programs;
use crate::shell::program;
use crate::{debian, guest_state};

/// What the guest needs, as Debian packages, with a file of each that tells whether it is there.
const PACKAGES: [(&str, &str); 4] = [
    ("user-mode-linux", "/usr/bin/linux.uml"),
    ("can-utils", "/usr/bin/canplayer"),
    ("busybox-static", "/usr/bin/busybox"),
    ("iproute2", "/usr/sbin/ip"),
];

/// Longest run, s: a hung guest would stay for ever.
const LIMIT_S: u32 = 900;

/// Installs what is missing.
pub(super) fn install() -> anyhow::Result<()> {
    debian::install(&PACKAGES)
}

/// What the guest wrote down: `name number` on each line.
pub(super) struct Results {
    folder: PathBuf,
    numbers: BTreeMap<String, u64>,
}

/// Starts the guest, which sees the files of this computer, and waits for its end. `python` runs the serial adapter; `seed`
/// draws the order in which things come and go.
pub(super) fn start(folder: &Path, programs: &Programs, python: &Path, seed: u32) -> anyhow::Result<Results> {
    let init = folder.join("init.sh");
    let adapter = fs::canonicalize("fixtures/slcan.py").context("fixtures/slcan.py")?;
    let head = format!(
        "#!/bin/sh\nWORK='{}'\nHMD='{}'\nFIRMWARE='{}'\nPYTHON='{}'\nADAPTER='{}'\nSEED={seed}\n",
        folder.display(),
        programs.hmd().display(),
        programs.firmware_sim().display(),
        python.display(),
        adapter.display()
    );
    fs::write(&init, head + include_str!("guest.sh"))?;
    fs::set_permissions(&init, fs::Permissions::from_mode(0o755))?;
    let results = folder.join("results");
    let _ = fs::remove_file(&results);
    let console = fs::File::create(folder.join("console.log"))?;
    let mut guest = program("taskset", ["--cpu-list".to_owned(), processor()?]);
    guest
        .args(["timeout".to_owned(), "--kill-after=5".to_owned(), LIMIT_S.to_string()])
        .args(["linux.uml", "mem=1G", "rootfstype=hostfs", "rootflags=/", "rw"])
        .args(["con=null", "con0=null,fd:1"])
        .arg(format!("init={}", init.display()))
        .env("LD_PRELOAD", guest_state::library()?)
        .stdin(Stdio::null())
        .stdout(console)
        .stderr(Stdio::null());
    // Its exit code says nothing; what it wrote does.
    let ended = guest.status().context("taskset")?;
    let text = fs::read_to_string(&results).unwrap_or_default();
    let numbers = text.lines().filter_map(|line| {
        let (name, number) = line.split_once(' ')?;
        Some((name.to_owned(), number.parse().ok()?))
    });
    let results = Results {
        folder: folder.to_owned(),
        numbers: numbers.collect(),
    };
    if results.number("done").is_err() {
        bail!(
            "the guest did not come to its end ({ended}); see {}",
            folder.join("console.log").display()
        );
    }
    Ok(results)
}

/// The one processor on which the guest runs, the last that this process may use. A system call in the guest is a hand-over
/// between two processes of the host; between two processors each waits for the other to wake, which takes ten times as long.
fn processor() -> anyhow::Result<String> {
    let path = "/proc/self/status";
    let status = fs::read_to_string(path).context(path)?;
    let allowed = between(&status, "Cpus_allowed_list:", "\n").context(path)?;
    let last = allowed.rsplit([',', '-']).next().unwrap_or(allowed);
    Ok(last.trim().to_owned())
}

impl Results {
    /// A number that the guest wrote down.
    pub(super) fn number(&self, name: &str) -> anyhow::Result<u64> {
        let found = self.numbers.get(name).copied();
        found.with_context(|| format!("expected the guest to write down {name}"))
    }

    /// Output of a daemon on stderr.
    pub(super) fn output(&self, name: &str) -> anyhow::Result<String> {
        let path = self.folder.join(name);
        fs::read_to_string(&path).with_context(|| path.display().to_string())
    }

    /// The number before a phrase in the plural, in the two lines with which a daemon ends.
    pub(super) fn counted(&self, name: &str, phrase: &str) -> anyhow::Result<u64> {
        let output = self.output(&format!("{name}.err"))?;
        // Of one thing it is said in the singular.
        let singular = |text: &str| {
            text.replace("frames", "frame")
                .replace("samples", "sample")
                .replace("windows", "window")
        };
        let last = output.lines().map(singular).filter(|line| {
            let is_count = [" frame received: ", " frame recorded, "]
                .iter()
                .any(|of| line.contains(of));
            is_count || line.starts_with("data lost: ")
        });
        let (last, phrase) = (last.collect::<Vec<_>>(), singular(phrase));
        for part in last.iter().flat_map(|line| line.split([',', ':'])) {
            if let Some(number) = part.trim().strip_suffix(&phrase) {
                return number.trim().parse().with_context(|| part.to_owned());
            }
        }
        // Without losses there is no second line.
        Ok(0)
    }
}

//! A working directory and the command `hmd` in it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::LazyLock;

use tempfile::TempDir;

/// A working directory of its own; commands run in it, so that messages name files as given.
pub(crate) struct Folder(TempDir);

/// How a command ended.
pub(crate) struct Ended {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary directory"))
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).unwrap_or_else(|e| panic!("{name}: {e}"));
    }

    pub(crate) fn write_lines(&self, name: &str, lines: impl IntoIterator<Item = impl AsRef<str>>) {
        let text: String = lines.into_iter().map(|line| format!("{}\n", line.as_ref())).collect();
        self.write(name, text);
    }

    /// Commissions a unit of a type by windows simulated with these options, in `healthy.log`; `hmd.toml` is the configuration that knows it.
    pub(crate) fn commission(&self, actuator: &str, windows_and_options: &str) {
        let unit = format!("[[actuator]]\nid = 0\ntype = \"{actuator}\"\n");
        self.write("new.toml", &unit);
        self.write("hmd.toml", format!("{unit}calibration = \"unit.toml\"\n"));
        self.done(&format!(
            "simulate --actuator {actuator} --windows {windows_and_options} -o healthy.log"
        ));
        self.done("calibrate healthy.log -c new.toml -o unit.toml");
    }

    /// The command for a line of arguments, with a backtrace wanted, so that a panic would show one.
    pub(crate) fn command(&self, line: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hmd"));
        command.args(line.split_whitespace()).current_dir(self.0.path());
        command.env("RUST_BACKTRACE", "1").stdin(Stdio::null());
        command
    }

    pub(crate) fn hmd(&self, line: &str) -> Ended {
        let output = self.command(line).output().expect("hmd starts");
        let text = |bytes| String::from_utf8(bytes).expect("hmd prints UTF-8");
        let (stdout, stderr) = (text(output.stdout), text(output.stderr));
        let code = output
            .status
            .code()
            .unwrap_or_else(|| panic!("hmd {line}: {}", output.status));
        assert!(
            !stderr.contains("panicked") && !stderr.contains("backtrace"),
            "hmd {line}:\n{stderr}"
        );
        Ended { code, stdout, stderr }
    }

    /// A command that does its work and loses nothing; returns what it printed.
    pub(crate) fn done(&self, line: &str) -> String {
        let ended = self.hmd(line);
        assert_eq!(ended.code, 0, "hmd {line}: {}", ended.stderr);
        ended.stdout
    }

    /// The records of a replay, one a window.
    pub(crate) fn replayed(&self, arguments: &str) -> Vec<serde_json::Value> {
        let lines = self.done(&format!("replay {arguments} --json"));
        let parsed = lines.lines().map(serde_json::from_str);
        parsed.collect::<Result<_, _>>().expect("lines of JSON")
    }

    /// A command that is refused with a code and one sentence, and prints no record.
    pub(crate) fn refused(&self, line: &str, code: i32) -> String {
        let ended = self.hmd(line);
        assert_eq!(ended.code, code, "hmd {line}: {}", ended.stderr);
        assert_eq!(ended.stderr.lines().count(), 1, "hmd {line}: {}", ended.stderr);
        assert!(ended.stdout.is_empty(), "hmd {line}: {}", ended.stdout);
        ended.stderr.trim_end().to_owned()
    }

    /// A command whose arguments are refused; the parser of arguments adds a hint on further lines.
    pub(crate) fn misused(&self, line: &str) -> String {
        let ended = self.hmd(line);
        assert_eq!(ended.code, 2, "hmd {line}");
        assert!(ended.stdout.is_empty(), "hmd {line}: {}", ended.stdout);
        ended.stderr.lines().next().unwrap_or_default().to_owned()
    }

    /// A healthy unit's actuation at 400 Hz as candump text, line by line: 600 samples, the trigger at sample 200.
    pub(crate) fn actuation(&self) -> Vec<String> {
        self.done("simulate -o actuation.log --rate 400 --seed 5");
        String::from_utf8(self.read("actuation.log"))
            .expect("text")
            .lines()
            .map(str::to_owned)
            .collect()
    }
}

/// Writes what `hmd demo -o life.mcap` makes into a folder, and returns the path of the recording; the demonstration runs once for all tests.
pub(crate) fn record_demo(folder: &Path) -> PathBuf {
    const FILES: [&str; 3] = ["life.mcap", "life.mcap.toml", "life.mcap.calibration.toml"];
    static MADE: LazyLock<[Vec<u8>; 3]> = LazyLock::new(|| {
        let folder = Folder::new();
        folder.done("demo -o life.mcap");
        FILES.map(|name| folder.read(name))
    });
    for (name, content) in FILES.iter().zip(&*MADE) {
        fs::write(folder.join(name), content).unwrap_or_else(|e| panic!("{name}: {e}"));
    }
    folder.join(FILES[0])
}

impl Ended {
    /// The only record, which must be there.
    pub(crate) fn record(&self) -> serde_json::Value {
        assert_eq!(self.stdout.lines().count(), 1, "{}{}", self.stdout, self.stderr);
        serde_json::from_str(&self.stdout).expect("a line of JSON")
    }
}

/// Index of the first line of sample n of [`Folder::actuation`]: its currents frame.
pub(crate) fn line_of_sample(lines: &[String], n: usize) -> usize {
    let currents = lines.iter().enumerate().filter(|(_, line)| line.contains(" 100#"));
    currents.map(|(index, _)| index).nth(n).expect("so many samples")
}

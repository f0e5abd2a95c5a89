//! Firmware on an emulated Cortex-M7, its serial port as a pseudo-terminal, `hmd run` at the other end, until a fault that
//! grows is found.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context, bail, ensure};
use serde_json::Value;

use crate::debian;
use crate::no_std::TARGET;
use crate::programs::Programs;
use crate::shell::{cargo, program, run, run_to_file, target_dir};
use crate::target::{FLAGS, PACKAGES};

/// Longest wait for anything that happens at once, and for all actuations of one actuator.
const SOON: Duration = Duration::from_secs(20);
const LIMIT: Duration = Duration::from_secs(120);

/// Actuations of each actuator.
const WINDOWS: usize = 10;

/// Farthest that an estimate may be from what the firmware was told.
const MOST_WRONG: f64 = 0.02;

/// Damage from which the default levels say `watch`, and `warning`.
const LEVELS: [(f64, &str); 2] = [(0.3, "warning"), (0.05, "watch")];

/// A fault that grows: its name, its place in the fault vector, what each actuation adds to it, and the seed.
struct Wear {
    name: &'static str,
    place: usize,
    growth: f64,
    seed: u64,
}

/// No damage comes near a level, so that each window has one right answer.
const WEARS: [Wear; 2] = [
    Wear {
        name: "friction",
        place: 0,
        growth: 0.036,
        seed: 11,
    },
    Wear {
        name: "short_b",
        place: 3,
        growth: 0.036,
        seed: 12,
    },
];

/// Effects of each family of a worn actuator in speed mode: words for the firmware, with two dashes options of the host program.
const EFFECTS: [&str; 15] = [
    "drive=vector",
    "with=dead_time_s=1.5e-6",
    "with=resistance_deviation=0.1",
    "with=speed_filter_hz=500",
    "with=compliance_hz=100",
    "with=stribeck_nm=0.1",
    "with=temperature_rise_k=-30",
    "with=cogging_nm=0.1",
    "with=spring_nm_per_rad=50",
    "with=emf_5=0.03",
    "with=short_resistance_ohm=0.1",
    "with=resolver_error_1_rad=0.005",
    "with=link_resistance_ohm=1",
    "k=0.2,0,0.2,0,0,0.1,0.5,0.5",
    "mode=speed",
];

/// Builds all programs, lets an actuator wear in each way, and compares one with effects to the host's.
pub(crate) fn check() -> anyhow::Result<()> {
    debian::install(&PACKAGES)?;
    run(program("rustup", ["target", "add", TARGET]))?;
    let image = ["build", "--quiet", "--profile", "image", "--package", "firmware_image"];
    run(cargo(image)
        .args(["--bin", "actuator", "--features", "image", "--target", TARGET])
        .env("RUSTFLAGS", FLAGS))?;
    let programs = Programs::build()?;
    for wear in &WEARS {
        let folder = target_dir()?.join("firmware").join(wear.name);
        if folder.exists() {
            fs::remove_dir_all(&folder).with_context(|| folder.display().to_string())?;
        }
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        watch(wear, &programs, &folder)
            .with_context(|| format!("{} that grows, in {}", wear.name, folder.display()))?;
    }
    let folder = target_dir()?.join("firmware").join("effects");
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    compare_with_effects(&programs, &folder).context("an actuator with effects")
}

/// An actuator with effects on the processor: the firmware sends what the host program sends.
fn compare_with_effects(programs: &Programs, folder: &Path) -> anyhow::Result<()> {
    let options = EFFECTS.map(|word| format!("--{word}"));
    let expected = host_bytes(programs, options, &folder.join("expected.bin"))?;
    let mut emulator = emulator()?;
    emulator.args(["-chardev", "stdio,id=uart"]).stdin(Stdio::piped());
    let mut processor = Running::start(&mut emulator, folder, "emulator")?;
    // The port stays open: the handle belongs to the child.
    let port = processor.child.stdin.as_mut().context("a pipe to the emulator")?;
    writeln!(port, "{}", EFFECTS.join(" "))?;
    let sent = processor.out.clone();
    processor.wait_until(LIMIT, "all frames", |_| length(&sent) >= expected.len() as u64)?;
    ensure!(
        fs::read(&sent)? == expected,
        "the firmware and the host program send different bytes, see {}",
        folder.display()
    );
    eprintln!("effects: {} bytes, as the host program sends them", expected.len());
    Ok(())
}

/// The whole life of one actuator on the processor, watched, assessed and compared.
fn watch(wear: &Wear, programs: &Programs, folder: &Path) -> anyhow::Result<()> {
    let hmd = || program(programs.hmd(), [] as [&str; 0]);
    let expected = by_host(wear, programs, &folder.join("expected.bin"))?;
    let sent = folder.join("sent.bin");
    let mut processor = Running::start(emulator()?.arg("-chardev").arg(logged(&sent)), folder, "emulator")?;
    let terminal = processor.wait_for("redirected to /dev/pts/")?;
    let config = folder.join("hmd.toml");
    fs::write(&config, configuration(&terminal)).with_context(|| config.display().to_string())?;
    let log = folder.join("run.mcap");
    let mut daemon = Running::start(
        hmd().args(["run", "--json", "-c"]).arg(&config).arg("-o").arg(&log),
        folder,
        "run",
    )?;
    daemon.wait_for("uart1: up")?;

    let told = format!("{}\n", wear.settings(""));
    let mut line = OpenOptions::new()
        .write(true)
        .open(&terminal)
        .with_context(|| terminal.clone())?;
    line.write_all(told.as_bytes()).context(terminal)?;
    let since = Instant::now();
    processor.wait_until(LIMIT, "all frames", |_| length(&sent) >= expected.len() as u64)?;
    let seconds = since.elapsed().as_secs_f64();
    ensure!(
        fs::read(&sent)? == expected,
        "the firmware and the host program send different bytes"
    );
    daemon.wait_until(LIMIT, "a line for each actuation", |output| {
        output.lines().filter(|line| line.starts_with('{')).count() >= WINDOWS
    })?;
    run(program("kill", ["-TERM", &daemon.child.id().to_string()]))?;
    let ended = daemon.wait(SOON)?;
    ensure!(ended.success(), "hmd run: {ended}: {}", daemon.output());

    let lines = daemon.lines();
    wear.check_lines(&lines)?;
    let replayed = folder.join("replay.jsonl");
    let mut replay = hmd();
    replay.args(["replay", "--json", "-c"]).arg(&config).arg(&log);
    run_to_file(replay, None, &replayed)?;
    ensure!(
        read(&replayed) == lines,
        "expected the live lines from a replay, see {}",
        replayed.display()
    );
    eprintln!(
        "{}: {WINDOWS} actuations, {} bytes in {seconds:.1} s, each as the host program sends it",
        wear.name,
        expected.len()
    );
    Ok(())
}

fn emulator() -> anyhow::Result<Command> {
    let mut emulator = program(
        "qemu-system-arm",
        ["-M", "mps2-an500", "-cpu", "cortex-m7", "-nographic"],
    );
    emulator
        .args(["-monitor", "none", "-semihosting", "-serial", "chardev:uart", "-kernel"])
        .arg(target_dir()?.join(TARGET).join("image/actuator"));
    Ok(emulator)
}

/// The serial port: a pseudo-terminal, and a file with all that goes out.
fn logged(sent: &Path) -> String {
    format!("pty,id=uart,logfile={}", sent.display())
}

fn configuration(terminal: &str) -> String {
    format!(
        "type.bench.tolerances = \"exact\"\n\n[[actuator]]\nid = 0\nname = \"m7\"\nbus = \"uart1\"\n\n[[serial]]\nbus = \"uart1\"\ndevice = \"{terminal}\"\n"
    )
}

/// What the host program sends by the same settings; it must be the very same bytes.
fn by_host(wear: &Wear, programs: &Programs, file: &Path) -> anyhow::Result<Vec<u8>> {
    let settings = wear.settings("--");
    host_bytes(programs, settings.split(' ').map(str::to_owned), file)
}

/// What the host program sends by these options.
fn host_bytes(programs: &Programs, options: impl IntoIterator<Item = String>, file: &Path) -> anyhow::Result<Vec<u8>> {
    run(program(programs.firmware_sim(), options).arg("--output").arg(file))?;
    fs::read(file).with_context(|| file.display().to_string())
}

fn length(file: &Path) -> u64 {
    fs::metadata(file).map_or(0, |file| file.len())
}

impl Wear {
    /// Settings of the firmware, or options of the host program.
    fn settings(&self, prefix: &str) -> String {
        let growth: Vec<String> = (0..8)
            .map(|k| if k == self.place { self.growth } else { 0.0 }.to_string())
            .collect();
        let settings = [
            ("noise", "0.05".to_owned()),
            ("windows", WINDOWS.to_string()),
            ("growth", growth.join(",")),
            ("seed", self.seed.to_string()),
        ];
        settings
            .map(|(name, value)| format!("{prefix}{name}={value}"))
            .join(" ")
    }

    /// Checks the lines: no fault before the damage, then its name alone, and its level.
    fn check_lines(&self, lines: &str) -> anyhow::Result<()> {
        let lines: Vec<&str> = lines.lines().collect();
        ensure!(
            lines.len() == WINDOWS,
            "expected {WINDOWS} lines, found {}",
            lines.len()
        );
        let mut worst = 0.0;
        for (n, line) in lines.iter().enumerate() {
            let record: Value = serde_json::from_str(line).with_context(|| (*line).to_owned())?;
            let damage = n as f64 * self.growth;
            let level = LEVELS.iter().find(|(from, _)| damage >= *from);
            let health = level.map_or("nominal", |(_, name)| name);
            let faults = level.map(|_| self.name).into_iter().collect::<Vec<_>>();
            let found = record["k"][self.place].as_f64().unwrap_or(f64::NAN);
            eprintln!(
                "  window {n}: {} {damage:.3}, found {found:.3}, {}",
                self.name, record["health"]
            );
            ensure!(
                record["status"] == "ok" && record["health"] == health && record["faults"] == Value::from(faults),
                "expected {health} at {damage:.3}, found {line}"
            );
            ensure!(
                (found - damage).abs() <= MOST_WRONG,
                "expected {damage:.3}, found {line}"
            );
            worst = f64::max(worst, (found - damage).abs());
        }
        eprintln!("  largest error {worst:.4}");
        Ok(())
    }
}

/// A running program with its output in two files; dropping this ends it.
struct Running {
    child: Child,
    out: PathBuf,
    err: PathBuf,
}

impl Running {
    fn start(command: &mut Command, folder: &Path, name: &str) -> anyhow::Result<Self> {
        let [out, err] = ["out", "err"].map(|kind| folder.join(format!("{name}.{kind}")));
        let [stdout, stderr] = [&out, &err].map(File::create);
        let child = command.stdout(stdout?).stderr(stderr?).spawn();
        let child = child.with_context(|| command.get_program().to_string_lossy().into_owned())?;
        Ok(Self { child, out, err })
    }

    /// All its output so far.
    fn output(&self) -> String {
        self.lines() + &read(&self.err)
    }

    /// What it has printed.
    fn lines(&self) -> String {
        read(&self.out)
    }

    /// Waits until its output contains `part`, and returns the word in which that ends.
    fn wait_for(&mut self, part: &str) -> anyhow::Result<String> {
        let whole_word = |output: &str| {
            let after = &output[output.find(part)? + part.rfind(' ')? + 1..];
            Some(after[..after.find(char::is_whitespace)?].to_owned())
        };
        self.wait_until(SOON, part, |output| whole_word(output).is_some())?;
        whole_word(&self.output()).context("expected what was there")
    }

    fn wait_until(&mut self, limit: Duration, what: &str, reached: impl Fn(&str) -> bool) -> anyhow::Result<()> {
        let since = Instant::now();
        while !reached(&self.output()) {
            let ended = self.child.try_wait()?;
            if since.elapsed() > limit || ended.is_some() {
                bail!(
                    "expected {what}, found after {:.0?}: {}",
                    since.elapsed(),
                    self.output()
                );
            }
            sleep(Duration::from_millis(20));
        }
        Ok(())
    }

    /// Waits for its end.
    fn wait(&mut self, limit: Duration) -> anyhow::Result<ExitStatus> {
        let since = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait()? {
                return Ok(status);
            }
            if since.elapsed() > limit {
                bail!("expected an end within {limit:.0?}, found: {}", self.output());
            }
            sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn read(file: &Path) -> String {
    fs::read(file)
        .map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
        .unwrap_or_default()
}

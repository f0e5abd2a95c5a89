//! The command as a shell sees it: exit codes, one clear sentence for each failure, the same bytes for the same input.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::process::{Command, Stdio};

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

    fn write_lines(&self, name: &str, lines: impl IntoIterator<Item = impl AsRef<str>>) {
        let text: String = lines.into_iter().map(|line| format!("{}\n", line.as_ref())).collect();
        self.write(name, text);
    }

    /// The command for a line of arguments, with a backtrace wanted, so that a panic would show one.
    fn command(&self, line: &str) -> Command {
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
    fn actuation(&self) -> Vec<String> {
        self.done("simulate -o actuation.log --rate 400 --seed 5");
        String::from_utf8(self.read("actuation.log"))
            .expect("text")
            .lines()
            .map(str::to_owned)
            .collect()
    }
}

impl Ended {
    /// The only record, which must be there.
    fn record(&self) -> serde_json::Value {
        assert_eq!(self.stdout.lines().count(), 1, "{}{}", self.stdout, self.stderr);
        serde_json::from_str(&self.stdout).expect("a line of JSON")
    }
}

/// Index of the first line of sample n: its currents frame.
fn line_of_sample(lines: &[String], n: usize) -> usize {
    let currents = lines.iter().enumerate().filter(|(_, line)| line.contains(" 100#"));
    currents.map(|(index, _)| index).nth(n).expect("so many samples")
}

/// A candump line with another stamp, µs later (or earlier).
fn shifted(line: &str, by_us: i64) -> String {
    let (stamp, rest) = line.split_once(')').expect("a stamp");
    let stamp = stamp
        .trim_start_matches('(')
        .replace('.', "")
        .parse::<i64>()
        .expect("a number")
        + by_us;
    format!("({}.{:06}){rest}", stamp / 1_000_000, stamp % 1_000_000)
}

#[test]
fn without_a_verb_or_with_an_unknown_one_the_usage_is_shown() {
    let folder = Folder::new();
    for line in [
        "",
        "nonsense",
        "replay",
        "simulate",
        "replay --nonsense",
        "replay a.log --threads 0",
        "evaluate nonsense",
        "evaluate random --n 0",
        "evaluate random --threads 0",
        "calibrate --type -o x.toml --threads 0",
    ] {
        let ended = folder.hmd(line);
        assert_eq!(ended.code, 2, "hmd {line}: {}", ended.stderr);
        assert!(
            ended.stdout.is_empty() && ended.stderr.contains("help"),
            "hmd {line}: {}",
            ended.stderr
        );
    }
    assert!(folder.done("--help").contains("Exit codes: 0 done, 1 failed, 2 usage"));
    assert!(folder.done("--version").starts_with("hmd "));
}

#[test]
fn a_bad_value_of_an_argument_is_named_and_nothing_is_written() {
    let folder = Folder::new();
    for (arguments, expected) in [
        ("--k 0,0,0,0,0,0,0.5", "--k: expected 8 numbers, found 7"),
        ("--k 0,0,0,0,0,0,0.5,0.5,0", "--k: expected 8 numbers, found 9"),
        ("--k 0,0,x,0,0,0,0.5,0.5", "invalid value 'x' for '--k"),
        (
            "--k 0,0,2,0,0,0,0.5,0.5",
            "short_a: expected a number from 0 to 1, found 2",
        ),
        (
            "--fault nonsense=1",
            "invalid value 'nonsense=1' for '--fault <NAME=K>': expected one of friction, backlash,",
        ),
        (
            "--fault friction",
            "invalid value 'friction' for '--fault <NAME=K>': expected NAME=K",
        ),
        ("--fault friction=much", "expected a number, found \"much\""),
        (
            "--fault friction=NaN",
            "friction: expected a number from 0 to 1, found NaN",
        ),
        (
            "--fault friction=1.5",
            "friction: expected a number from 0 to 1, found 1.5",
        ),
        ("--rate 333", "--rate: "),
        ("--rate NaN", "expected a number from 50 to 20000"),
        (
            "--rate 2500",
            "--rate: expected at most 90 % of a 1 Mbit/s bus, found 90.",
        ),
        ("--rate 1e9", "expected a number from 50 to 20000"),
        ("--load inf", "expected a number from -1e6 to 1e6"),
        ("--noise -1", "'-1'"),
        ("--windows 0", "'--windows <WINDOWS>'"),
        ("--profile nonsense", "expected step, ramp, chirp or mixed"),
        ("--mode idle", "invalid value 'idle' for '--mode <position|speed>'"),
        (
            "--with coging_nm=0.1",
            "for '--with <EFFECT=VALUE>': unknown effect: expected a name such as cogging_nm,",
        ),
        ("--with cogging_nm", "'--with <EFFECT=VALUE>': expected EFFECT=VALUE"),
        ("--with cogging_nm=much", "expected a number, found \"much\""),
        ("--with emf_5=0.5", "emf_5 = 0.5: expected a number from -0.3 to 0.3"),
        ("--with emf_5=NaN", "emf_5 = NaN: expected a number from -0.3 to 0.3"),
        (
            "--with control_delay_periods=0.5",
            "control_delay_periods = 0.5: expected a whole number",
        ),
        (
            "--drive stepper",
            "for '--drive <hysteresis|vector>': expected hysteresis or vector",
        ),
        (
            "--with decoupling=0.5",
            "hmd: decoupling: expected the vector drive, found the hysteresis drive",
        ),
        (
            "--with dead_time_s=1e-6 --drive hysteresis",
            "hmd: dead_time_s: expected the vector drive, found the hysteresis drive",
        ),
        (
            "--with gear_teeth=11",
            "hmd: gear_teeth: expected mesh_ripple as well, of which it is a parameter",
        ),
        (
            "--with cogging_nm=0 --with cogging_phase_rad=1",
            "hmd: cogging_phase_rad: expected cogging_nm, of which it is a parameter, other than 0",
        ),
        ("--with link_resistance_ohm=10000", "expected a number from 0 to 100"),
        (
            "--actuator nonsense",
            "--actuator: expected bench, servo28, servo270 or a type of the configuration, found \"nonsense\"",
        ),
        ("--id 16", "'--id <ID>'"),
        ("--seed x", "'--seed <SEED>'"),
    ] {
        let sentence = folder.misused(&format!("simulate -o out.log {arguments}"));
        assert!(sentence.contains(expected), "{arguments}: {sentence}");
        assert!(!folder.path("out.log").exists(), "{arguments}: a log was written");
    }
    let sentence = folder.misused("simulate -o out.txt");
    assert!(
        sentence.ends_with("out.txt: expected a name that ends in .mcap or .log"),
        "{sentence}"
    );
}

#[test]
fn a_file_that_is_no_log_is_refused_in_one_sentence() {
    let folder = Folder::new();
    fs::create_dir(folder.path("folder")).expect("a folder");
    folder.write("empty.log", "");
    folder.write("text.log", "Dear reader,\nthis is no log.\n");
    folder.write("zeros.log", [0; 4096]);
    let noise: Vec<u8> = (0..100_000_u32)
        .map(|n| (n.wrapping_mul(2_654_435_761) >> 24) as u8)
        .collect();
    folder.write("noise.mcap", noise);
    folder.write("foreign.mcap", foreign_mcap());
    for (log, expected) in [
        (
            "none.log",
            "expected a readable file, found: No such file or directory (os error 2)",
        ),
        ("folder", "expected a file, found a directory"),
        ("empty.log", "expected a candump or MCAP log, found an empty file"),
        (
            "text.log",
            "expected a candump or MCAP log, found no valid line in 2; the first: text.log:1: expected a stamp \
             \"(seconds.fraction)\" with 6 or 9 decimals, found \"Dear\"",
        ),
        (
            "zeros.log",
            "expected a candump or MCAP log, found binary data starting with \"\\x00",
        ),
        ("noise.mcap", "expected a candump or MCAP log, found no valid line in "),
        (
            "foreign.mcap",
            "expected raw frames (schema hmd.v1.RawBatch) on topics /bus/<interface>/raw, found only /camera",
        ),
    ] {
        let sentence = folder.refused(&format!("replay --json {log}"), 1);
        assert!(sentence.starts_with(&format!("hmd: {log}: {expected}")), "{sentence}");
    }
}

/// An MCAP file that another program made, in whole.
fn foreign_mcap() -> Vec<u8> {
    let mut file = std::io::Cursor::new(Vec::new());
    let mut writer = mcap::Writer::new(&mut file).expect("a writer");
    let schema = writer
        .add_schema("foreign.Image", "jsonschema", b"{}")
        .expect("a schema");
    let channel = writer
        .add_channel(schema, "/camera", "json", &BTreeMap::new())
        .expect("a channel");
    let header = mcap::records::MessageHeader {
        channel_id: channel,
        sequence: 0,
        log_time: 1,
        publish_time: 1,
    };
    writer.write_to_known_channel(&header, b"{}").expect("a message");
    writer.finish().expect("a footer");
    drop(writer);
    file.into_inner()
}

#[test]
fn a_log_without_what_is_needed_reports_what_is_missing() {
    let folder = Folder::new();
    let lines = folder.actuation();
    folder.write_lines(
        "unknown.log",
        lines.iter().map(|line| format!("{} can0 7FF#0011", &line[..19])),
    );
    let sentence = folder.refused("replay --json unknown.log", 1);
    let expected = format!(
        "hmd: unknown.log: expected frames of an actuator with the identifiers of ema.dbc, or a configuration (-c) that \
         maps the DBC file of this bus, found none ({} other frames on can0)",
        lines.len()
    );
    assert_eq!(sentence, expected);

    folder.write_lines("half.log", lines.iter().filter(|line| !line.contains(" 101#")));
    let sentence = folder.refused("replay --json half.log", 1);
    assert!(
        sentence.starts_with("hmd: half.log: expected currents, position and command of one sample"),
        "{sentence}"
    );

    // Whole samples and no actuation is no failure: the actuator just rested.
    folder.write_lines("rest.log", &lines[..line_of_sample(&lines, 150)]);
    let ended = folder.hmd("replay --json rest.log");
    assert_eq!((ended.code, ended.stdout.as_str()), (0, ""), "{}", ended.stderr);
    assert!(
        ended.stderr.ends_with(
            "rest.log: expected an actuation, found none in 150 samples: a setpoint that rests and then moves, in a \
                 mode that is not idle\n"
        ),
        "{}",
        ended.stderr
    );
}

#[test]
fn a_gap_degrades_the_window_or_makes_it_invalid_and_ends_in_data_loss() {
    let folder = Folder::new();
    let lines = folder.actuation();
    let without = |name: &str, first: usize, count: usize| {
        let (from, to) = (line_of_sample(&lines, first), line_of_sample(&lines, first + count));
        folder.write_lines(name, lines[..from].iter().chain(&lines[to..]));
        let ended = folder.hmd(&format!("replay --json {name}"));
        assert_eq!(ended.code, 3, "{}", ended.stderr);
        assert!(
            ended.stderr.contains(&format!("{name}: data lost: ")),
            "{}",
            ended.stderr
        );
        assert!(ended.stderr.contains(&format!(" {count} samples")), "{}", ended.stderr);
        ended.record()
    };
    let short = without("short.log", 330, 2);
    assert_eq!(short["status"], "degraded");
    assert!(
        short["k"].is_array() && short["faults"].as_array().is_some_and(Vec::is_empty),
        "{short}"
    );

    let long = without("long.log", 330, 20);
    assert_eq!(
        (&long["status"], &long["health"]),
        (&"invalid".into(), &"unknown".into())
    );
    assert!(
        long["k"].is_null() && long["faults"].as_array().is_some_and(Vec::is_empty),
        "{long}"
    );
    assert_eq!(long["reason"], "gap: 20 samples unusable, 20 in a row");
}

#[test]
fn an_unreadable_line_and_a_short_frame_are_counted() {
    let folder = Folder::new();
    let mut lines = folder.actuation();
    lines.truncate(line_of_sample(&lines, 100));
    let short = line_of_sample(&lines, 50);
    let line = &mut lines[short];
    line.truncate(line.len() - 2);
    lines.insert(10, "garbage".to_owned());
    folder.write_lines("bad.log", &lines);
    let ended = folder.hmd("replay --json bad.log");
    assert_eq!((ended.code, ended.stdout.as_str()), (3, ""), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("bad.log:11: expected a stamp"),
        "{}",
        ended.stderr
    );
    assert!(
        ended
            .stderr
            .contains("data lost: 1 unreadable lines or frames, 0 damaged places of a file with 0 frames missing by count, 1 malformed frames, 1 samples")
    );
}

#[test]
fn stamps_that_step_back_do_not_stop_the_monitoring() {
    let folder = Folder::new();
    let lines = folder.actuation();
    // The host's clock is set back by two seconds between two samples, before the window.
    let step = line_of_sample(&lines, 150);
    let stepped = lines.iter().enumerate();
    folder.write_lines(
        "step.log",
        stepped.map(|(n, line)| shifted(line, if n < step { 0 } else { -2_000_000 })),
    );
    let ended = folder.hmd("replay --json step.log");
    assert!([0, 3].contains(&ended.code), "{}", ended.stderr);
    let record = ended.record();
    assert!(record["k"].is_array() && record["health"] == "nominal", "{record}");
}

#[test]
fn a_log_in_reversed_order_is_never_assessed() {
    let folder = Folder::new();
    let lines = folder.actuation();
    folder.write_lines("reversed.log", lines.iter().rev());
    let ended = folder.hmd("replay --json reversed.log");
    assert!(ended.stderr.contains("reversed.log: "), "{}", ended.stderr);
    for line in ended.stdout.lines() {
        assert!(line.contains("\"status\":\"invalid\""), "{line}");
    }
}

#[test]
fn frames_dropped_for_their_order_are_data_loss() {
    let folder = Folder::new();
    let lines = folder.actuation();
    folder.write_lines("reversed.log", lines.iter().rev());
    assert_eq!(folder.hmd("replay --json reversed.log").code, 3);
}

#[test]
fn a_cut_mcap_gives_what_is_whole_and_ends_in_data_loss() {
    let folder = Folder::new();
    folder.done("simulate -o whole.mcap --rate 400 --seed 5");
    let whole = folder.read("whole.mcap");
    // Without its end only the index is missing: the one chunk of this file is whole.
    folder.write("cut.mcap", &whole[..whole.len() - 20]);
    let ended = folder.hmd("replay --json cut.mcap");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(ended.stderr.contains("cut.mcap: at byte "), "{}", ended.stderr);
    assert!(
        ended
            .stderr
            .contains("found the end of the file: it was cut or never finished"),
        "{}",
        ended.stderr
    );
    assert_eq!(ended.stdout, folder.done("replay --json whole.mcap"));

    folder.write("stump.mcap", &whole[..whole.len() / 2]);
    let sentence = folder.refused("replay --json stump.mcap", 1);
    assert!(
        sentence.starts_with("hmd: stump.mcap: expected raw frames") && sentence.contains("it was cut"),
        "{sentence}"
    );

    // A damaged chunk has another checksum, and is not used.
    let mut damaged = whole.clone();
    damaged[whole.len() / 3] ^= 0x10;
    folder.write("damaged.mcap", damaged);
    let sentence = folder.refused("replay --json damaged.mcap", 1);
    assert!(sentence.starts_with("hmd: damaged.mcap: "), "{sentence}");
}

#[test]
fn a_bad_configuration_is_code_78_with_line_key_expected_and_found() {
    let folder = Folder::new();
    folder.write("any.log", "");
    for (text, expected) in [
        (
            "[health]\nwatch = nan\n",
            "bad.toml:2: health.watch: expected a number from 0.001 to 1, found nan",
        ),
        (
            "[health]\nwatch = 1e300\n",
            "bad.toml:2: health.watch: expected a number from 0.001 to 1, found 1e300",
        ),
        (
            "[health]\nwatch = \"often\"\n",
            "bad.toml:2: health.watch: expected a number from 0.001 to 1, found \"often\"",
        ),
        (
            "\n[health]\nwotch = 0.1\n",
            "bad.toml:3: health.wotch: unknown key; did you mean watch?",
        ),
        ("[health\n", "bad.toml:1: not valid TOML: "),
        (
            "[type.bench.motor]\ninertia_kg_m2 = -1.0\n",
            "bad.toml:2: type.bench.motor.inertia_kg_m2: expected ",
        ),
        (
            "[type.bench.sensors]\nsample_rate_hz = 333.0\n",
            "bad.toml:2: type.bench.sensors.sample_rate_hz: expected ",
        ),
    ] {
        folder.write("bad.toml", text);
        for verb in ["check-config", "replay any.log", "simulate -o out.log"] {
            let sentence = folder.refused(&format!("{verb} -c bad.toml"), 78);
            assert!(sentence.starts_with(&format!("hmd: {expected}")), "{sentence}");
        }
    }
    let sentence = folder.refused("check-config -c none.toml", 78);
    assert!(sentence.starts_with("hmd: none.toml: cannot be read: "), "{sentence}");
    folder.write("good.toml", "[health]\nwatch = 0.1\n");
    assert!(folder.done("check-config -c good.toml").contains("0.1"));
    assert!(!folder.done("check-config").is_empty());
}

#[test]
fn an_output_that_cannot_be_written_is_named() {
    let folder = Folder::new();
    folder.actuation();
    fs::create_dir(folder.path("folder.mcap")).expect("a folder");
    for output in ["none/out.mcap", "folder.mcap"] {
        for verb in ["replay --json actuation.log", "simulate", "demo"] {
            let sentence = folder.refused(&format!("{verb} -o {output}"), 1);
            assert!(sentence.starts_with(&format!("hmd: {output}: ")), "{sentence}");
        }
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_fails() {
    let folder = Folder::new();
    for name in ["full.log", "full.mcap"] {
        std::os::unix::fs::symlink("/dev/full", folder.path(name)).expect("a link");
        let sentence = folder.refused(&format!("simulate -o {name} --rate 400"), 1);
        assert!(sentence.contains("No space left on device"), "{sentence}");
    }
    let stdout = fs::File::options().write(true).open("/dev/full").expect("/dev/full");
    let ended = folder
        .command("check-config")
        .stdout(stdout)
        .output()
        .expect("hmd starts");
    assert_eq!(ended.status.code(), Some(1));
}

#[test]
fn a_message_contains_each_fact_once_and_names_the_file() {
    let folder = Folder::new();
    folder.actuation();
    for (line, code, file) in [
        ("check-config -c none.toml", 78, "none.toml"),
        ("replay --json actuation.log -o none/out.mcap", 1, "none/out.mcap"),
        ("replay --json actuation.log -o /dev/full", 1, "/dev/full"),
    ] {
        let sentence = folder.refused(line, code);
        assert!(sentence.starts_with(&format!("hmd: {file}: ")), "{sentence}");
        assert_eq!(sentence.matches("(os error").count(), 1, "{sentence}");
    }
}

#[test]
fn a_log_is_never_overwritten_by_its_own_replay() {
    let folder = Folder::new();
    folder.actuation();
    let before = folder.read("actuation.log");
    folder.refused("replay --json actuation.log -o ./actuation.log", 2);
    assert_eq!(folder.read("actuation.log"), before);
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let folder = Folder::new();
    folder.actuation();
    for line in ["replay --json actuation.log", "replay actuation.log", "check-config"] {
        let mut child = folder
            .command(line)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("hmd starts");
        drop(child.stdout.take());
        let ended = child.wait_with_output().expect("hmd ends");
        let stderr = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(0), "hmd {line}: {stderr}");
        assert!(!stderr.contains("panicked"), "hmd {line}: {stderr}");
    }
}

#[test]
fn a_reader_that_goes_away_leaves_a_whole_output_file() {
    let folder = Folder::new();
    folder.actuation();
    folder.done("replay --json actuation.log -o undisturbed.mcap");
    let mut child = folder
        .command("replay --json actuation.log -o out.mcap")
        .stdout(Stdio::piped())
        .spawn()
        .expect("hmd");
    drop(child.stdout.take());
    child.wait().expect("hmd ends");
    assert_eq!(folder.read("out.mcap"), folder.read("undisturbed.mcap"));
}

#[test]
fn one_run_gives_the_same_lines_from_text_and_mcap_on_any_number_of_threads() {
    let folder = Folder::new();
    for log in ["run.log", "run.mcap"] {
        folder.done(&format!(
            "simulate -o {log} --rate 400 --windows 2 --fault backlash=0.3 --noise 0.05 --seed 9"
        ));
    }
    assert_eq!(folder.read("run.log.truth.jsonl"), folder.read("run.mcap.truth.jsonl"));

    let lines = folder.done("replay --json run.log --threads 1 -o one.mcap");
    assert_eq!(lines.lines().count(), 2);
    for line in lines.lines() {
        let record: serde_json::Value = serde_json::from_str(line).expect("a line of JSON");
        assert_eq!(
            (&record["status"], &record["faults"]),
            (&"ok".into(), &["backlash"].as_slice().into()),
            "{line}"
        );
    }
    assert_eq!(folder.done("replay --json run.mcap --threads 4"), lines);

    // Truth is for `evaluate` alone.
    fs::remove_file(folder.path("run.log.truth.jsonl")).expect("a truth file");
    assert_eq!(folder.done("replay --json run.log --threads 4 -o four.mcap"), lines);
    assert!(
        folder.read("one.mcap") == folder.read("four.mcap"),
        "the output files differ"
    );

    // The output holds the frames as they came.
    assert_eq!(folder.done("replay --json four.mcap"), lines);
}

#[test]
fn the_drive_of_the_type_keeps_its_parameters_and_another_is_in_the_truth() {
    let folder = Folder::new();
    let short = "--actuator servo270 --rate 400 --seed 2";
    for (log, drive) in [
        ("own", ""),
        ("named", "--drive vector"),
        ("other", "--drive hysteresis"),
    ] {
        folder.done(&format!("simulate -o {log}.log {short} {drive}"));
    }
    for file in ["log", "log.truth.jsonl"] {
        assert_eq!(
            folder.read(&format!("own.{file}")),
            folder.read(&format!("named.{file}"))
        );
    }
    let drive = |log: &str| -> serde_json::Value {
        let truth = folder.read(&format!("{log}.log.truth.jsonl"));
        let line: serde_json::Value = serde_json::from_slice(&truth).expect("a line of JSON");
        line["drive"].clone()
    };
    assert_eq!([drive("own"), drive("other")], ["vector", "hysteresis"]);
    assert!(folder.read("own.log") != folder.read("other.log"));

    // An effect at its value without effect is off.
    folder.done("simulate -o plain.log --rate 400");
    folder.done("simulate -o off.log --rate 400 --with cogging_nm=0 --with saturation=0");
    for file in ["log", "log.truth.jsonl"] {
        assert_eq!(
            folder.read(&format!("plain.{file}")),
            folder.read(&format!("off.{file}"))
        );
    }
}

#[test]
fn the_same_seed_simulates_the_same_bytes() {
    let folder = Folder::new();
    for (name, seed) in [("a", 1), ("b", 1), ("c", 2)] {
        for kind in ["log", "mcap"] {
            folder.done(&format!(
                "simulate -o {name}.{kind} --rate 400 --noise 0.05 --seed {seed}"
            ));
        }
    }
    for kind in ["log", "mcap"] {
        let [a, b, c] = ["a", "b", "c"].map(|name| folder.read(&format!("{name}.{kind}")));
        assert!(a == b && a != c, "{kind}");
    }
}

#[test]
fn a_json_line_has_the_documented_keys_in_order() {
    let folder = Folder::new();
    folder.actuation();
    let line = folder.done("replay --json actuation.log");
    let mut at = 0;
    for key in [
        "actuator",
        "window",
        "t_start_ns",
        "status",
        "k",
        "sigma",
        "observable",
        "cost",
        "residual_rms_a",
        "evaluations",
        "health",
        "faults",
        "rul_h",
        "rul_cycles",
    ] {
        let found = line[at..]
            .find(&format!("\"{key}\":"))
            .unwrap_or_else(|| panic!("{key} is not in its place: {line}"));
        at += found;
    }
    let timed = folder.done("replay --json --timings actuation.log");
    assert!(timed.contains("elapsed_ms") && !line.contains("elapsed_ms"));
}

/// A line with its data bytes changed.
fn with_bytes(line: &str, change: impl FnOnce(&mut Vec<u8>)) -> String {
    let (head, data) = line.split_once('#').expect("a frame");
    let digits = |at: usize| u8::from_str_radix(&data[at..at + 2], 16).expect("hex");
    let mut bytes: Vec<u8> = (0..data.len() / 2).map(|n| digits(2 * n)).collect();
    change(&mut bytes);
    let data: String = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    format!("{head}#{data}")
}

#[test]
fn a_device_time_that_stands_still_is_reported_and_the_window_assessed_at_the_nominal_rate() {
    let folder = Folder::new();
    let lines = folder.actuation();
    folder.write_lines(
        "still.log",
        lines.iter().map(|line| match line.contains(" 102#") {
            true => with_bytes(line, |bytes| bytes[5..7].fill(0)),
            false => line.clone(),
        }),
    );
    folder.write("400.toml", "[type.bench.sensors]\nsample_rate_hz = 400\n");
    let ended = folder.hmd("replay --json still.log -c 400.toml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    assert!(
        ended.stderr.contains("ema0: expected a device time that advances") && ended.stderr.contains("nominal 400"),
        "{}",
        ended.stderr
    );
    assert!(ended.record()["k"].is_array());
}

#[test]
fn a_rate_at_which_no_window_can_be_cut_is_data_loss() {
    let folder = Folder::new();
    folder.actuation();
    // Possible at the nominal 2 kHz, not at the 400 Hz found.
    folder.write("short.toml", "[window]\npre_trigger_ms = 1\n");
    let ended = folder.hmd("replay --json actuation.log -c short.toml");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(ended.stderr.contains("ema0: not monitored: "), "{}", ended.stderr);
    assert!(ended.stderr.contains(" 600 samples"), "{}", ended.stderr);
}

#[test]
fn a_configuration_that_cannot_work_is_refused_before_anything_is_read() {
    let folder = Folder::new();
    folder.actuation();
    folder.write("bad.toml", "this is no calibration");
    for (text, expected) in [
        (
            "[window]\nduration_ms = 20000",
            "window.duration_ms: expected a number from 20 to 10000, found 20000",
        ),
        (
            "[window]\npre_trigger_ms = 100",
            "window.pre_trigger_ms: expected at most rest_ms = 20, found 100",
        ),
        (
            "[type.bench]\ncalibration = \"none.toml\"",
            "type.bench.calibration: none.toml: No such file",
        ),
        (
            "[type.bench]\ncalibration = \"bad.toml\"",
            "type.bench.calibration: bad.toml: expected a type calibration",
        ),
    ] {
        folder.write("hmd.toml", text);
        for line in ["check-config -c hmd.toml", "replay --json actuation.log -c hmd.toml"] {
            let sentence = folder.refused(line, 78);
            assert!(sentence.contains(expected), "{line}: {sentence}");
        }
    }
}

#[test]
fn frames_of_an_earlier_log_are_not_used_again() {
    let folder = Folder::new();
    let lines = folder.actuation();
    let once = folder.done("replay --json actuation.log");
    let twice = folder.hmd("replay --json actuation.log actuation.log");
    assert_eq!((twice.code, &twice.stdout), (3, &once), "{}", twice.stderr);
    let expected = format!(
        "actuation.log: expected frames later than those of the logs before, found {} that are not",
        lines.len()
    );
    assert!(twice.stderr.contains(&expected), "{}", twice.stderr);

    let middle = line_of_sample(&lines, 100);
    folder.write_lines("a.log", &lines[..middle]);
    folder.write_lines("b.log", &lines[middle..]);
    let ordered = folder.hmd("replay --json a.log b.log");
    assert_eq!(ordered.code, 0, "{}", ordered.stderr);
    let reversed = folder.hmd("replay --json b.log a.log");
    assert_eq!(reversed.code, 3, "{}", reversed.stderr);
    assert!(
        reversed.stderr.contains("a.log: expected frames later"),
        "{}",
        reversed.stderr
    );
}

#[test]
fn malformed_frames_alone_are_counted_as_such() {
    let folder = Folder::new();
    let lines = folder.actuation();
    let short = lines.iter().map(|line| with_bytes(line, |bytes| bytes.truncate(7)));
    folder.write_lines("short.log", short);
    let sentence = folder.refused("replay --json short.log", 1);
    assert!(
        sentence.ends_with(&format!("found none ({} malformed frames on can0)", lines.len())),
        "{sentence}"
    );
}

#[test]
fn an_option_that_a_suite_does_not_read_is_refused() {
    for (line, expected) in [
        ("evaluate paper --n 3", "--n: expected none with the suite paper"),
        (
            "evaluate rul --n 1 --monitor paper",
            "--monitor: expected none with the suite rul",
        ),
        (
            "evaluate rul --n 1 --method ga",
            "--method: expected none with the suite rul",
        ),
        (
            "evaluate robust --config hmd.toml",
            "--config: expected none with the suite robust",
        ),
        ("evaluate paper --rate 400", "--rate: expected none with this suite"),
        ("evaluate robust --rate 333", "--rate: 1 / sensors.sample_rate = "),
        ("evaluate robust --entry nix", "--entry: expected one of vector_drive, "),
        (
            "evaluate robust --actuator nix",
            "--actuator: expected one of bench, servo28, servo270, found \"nix\"",
        ),
    ] {
        let sentence = Folder::new().refused(line, 2);
        assert!(sentence.contains(expected), "{sentence}");
    }
}

#[test]
fn the_robust_suite_resumes_and_refuses_the_state_of_another_run() {
    let folder = Folder::new();
    let line = "evaluate robust --n 1 --rate 400 --actuator servo28 --entry resistance --resume state.jsonl --json";
    let first = folder.done(line);
    let report: serde_json::Value = serde_json::from_str(&first).expect("JSON");
    assert_eq!(report["units"], 1);
    assert!(report["before"]["judged_rate"].is_f64() && report["after"]["named_rate"].is_f64());
    let state = folder.read("state.jsonl");
    assert_eq!(folder.done(line), first);
    assert_eq!(folder.read("state.jsonl"), state);
    let sentence = folder.refused(&line.replace("--n 1", "--n 2"), 1);
    assert!(
        sentence.contains("state.jsonl: expected the state of the run"),
        "{sentence}"
    );
}

#[test]
fn a_lost_footer_is_no_lost_frame() {
    let folder = Folder::new();
    folder.done("simulate -o whole.mcap --rate 400 --seed 5");
    let whole = folder.read("whole.mcap");
    folder.write("cut.mcap", &whole[..whole.len() - 20]);
    let ended = folder.hmd("replay --json cut.mcap");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(
        ended
            .stderr
            .contains(" 1 damaged places of a file with 0 frames missing by count"),
        "{}",
        ended.stderr
    );
}

#[test]
fn a_device_that_restarts_in_the_window_is_reported() {
    let folder = Folder::new();
    let lines = folder.actuation();
    let (from, to) = (line_of_sample(&lines, 100), line_of_sample(&lines, 300));
    folder.write_lines("restart.log", lines[..to].iter().chain(&lines[from..]));
    let ended = folder.hmd("replay --json restart.log");
    assert!(
        ended
            .stderr
            .contains("ema0: expected a sample counter that rises, found one that went back"),
        "{}",
        ended.stderr
    );
    let first = ended.stdout.lines().next().unwrap_or_default();
    assert!(
        first.contains("\"status\":\"invalid\"") && first.contains("cut short"),
        "{first}"
    );
}

#[test]
fn a_text_from_another_system_is_the_same_log() {
    let folder = Folder::new();
    let lines = folder.actuation();
    let text: String = lines.iter().map(|line| format!("{line}\r\n")).collect();
    folder.write("windows.log", format!("\u{feff}{text}"));
    assert_eq!(
        folder.done("replay --json windows.log"),
        folder.done("replay --json actuation.log")
    );
}

#[test]
fn a_compressed_log_and_a_damaged_only_chunk_are_named() {
    let folder = Folder::new();
    folder.write("log.gz", b"\x1f\x8b\x08\0anything\n");
    assert_eq!(
        folder.refused("replay log.gz", 1),
        "hmd: log.gz: expected a candump or MCAP log, found gzip data; decompress it first"
    );
    folder.done("simulate -o flip.mcap --rate 400 --seed 5");
    let mut bytes = folder.read("flip.mcap");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    folder.write("flip.mcap", bytes);
    let sentence = folder.refused("replay flip.mcap", 1);
    assert!(
        sentence.contains("/bus/<interface>/raw, found none that is intact; flip.mcap: at byte "),
        "{sentence}"
    );
}

#[test]
fn a_commissioned_unit_is_assessed_by_its_calibration() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --noise 0.05 --windows 5 --load 4 --seed 3 -o healthy.log");
    folder.done("calibrate healthy.log -o unit.toml");
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    folder.done("check-config -c hmd.toml");
    folder.done("simulate --rate 400 --noise 0.05 --seed 9 --fault short_b=0.2 -o worn.log");
    let lines = folder.done("replay worn.log -c hmd.toml --json");
    assert!(lines.contains("\"faults\":[\"short_b\"]"), "{lines}");

    folder.write(
        "other.toml",
        "[[actuator]]\nid = 0\ntype = \"servo28\"\ncalibration = \"unit.toml\"\n",
    );
    let refused = folder.hmd("check-config -c other.toml");
    assert_eq!(refused.code, 78);
    assert!(
        refused
            .stderr
            .contains("expected a unit of type servo28, found one of type bench"),
        "{}",
        refused.stderr
    );
}

#[test]
fn a_unit_with_a_vector_drive_is_commissioned_by_its_relations() {
    let folder = Folder::new();
    let drive = "--drive vector --with dead_time_s=1.5e-6 --with dynamic_friction_deviation=0.2 --noise 0.03";
    folder.done(&format!("simulate {drive} --windows 6 --seed 3 -o healthy.log"));
    let ended = folder.hmd("calibrate healthy.log -o unit.toml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    for expected in [
        "assessed by the relations between measured signals",
        "smallest damage that shows: friction",
    ] {
        assert!(ended.stderr.contains(expected), "{expected} in\n{}", ended.stderr);
    }
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    folder.done(&format!("simulate {drive} --windows 3 --seed 9 -o later.log"));
    let lines = folder.done("replay later.log -c hmd.toml --json");
    assert_eq!(lines.matches("\"status\":\"ok\"").count(), 3, "{lines}");
    assert_eq!(lines.matches("\"faults\":[]").count(), 3, "{lines}");
    folder.done(&format!("simulate {drive} --fault friction=0.2 --seed 11 -o worn.log"));
    let lines = folder.done("replay worn.log -c hmd.toml --json");
    assert!(lines.contains("\"faults\":[\"friction\"]"), "{lines}");

    // Other parameters of the type than at commissioning.
    folder.write(
        "changed.toml",
        "[type.bench.motor]\ninertia_kg_m2 = 1.1e-3\n[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n",
    );
    let ended = folder.hmd("check-config -c changed.toml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    let expected = "unit.toml: warning: the parameters of type bench have changed since ema0 was commissioned";
    assert!(ended.stderr.contains(expected), "{}", ended.stderr);
}

#[test]
fn a_parameter_far_from_the_type_is_named_and_not_written() {
    let folder = Folder::new();
    folder.done("simulate --with inertia_deviation=0.6 --noise 0.03 --windows 5 --seed 3 -o healthy.log");
    let text = folder.refused("calibrate healthy.log -o unit.toml", 1);
    let key = "type.bench.motor.inertia_kg_m2: expected 0.001 within 5 tolerances";
    assert!(text.contains(key), "{text}");
    assert!(!folder.path("unit.toml").exists());

    folder.done("simulate --with inertia_deviation=-0.4 --noise 0.03 --windows 5 --seed 3 -o healthy.log");
    let text = folder.refused("calibrate healthy.log -o unit.toml", 1);
    assert!(text.contains(key), "{text}");

    // Where the monitor does not explain the unit: the relations need no resistance.
    let effects = "--with resistance_deviation=0.6 --with emf_5=0.03 --with stribeck_nm=0.1";
    folder.done(&format!(
        "simulate {effects} --noise 0.03 --windows 5 --seed 3 -o healthy.log"
    ));
    let ended = folder.hmd("calibrate healthy.log -o unit.toml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    let key = "the monitor is not used: type.bench.motor.phase_resistance_ohm: expected 2.75 within 5 tolerances";
    assert!(ended.stderr.contains(key), "{}", ended.stderr);
    let written = String::from_utf8(folder.read("unit.toml")).expect("text");
    assert!(!written.contains("[monitor]"), "{written}");
}

#[test]
fn calibrations_in_the_wrong_place_are_refused() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --noise 0.05 --windows 5 --seed 3 -o healthy.log");
    folder.done("calibrate healthy.log -o unit.toml");
    folder.write("as_type.toml", "[type.bench]\ncalibration = \"unit.toml\"\n");
    let text = folder.refused("check-config -c as_type.toml", 78);
    assert!(
        text.contains("expected a type calibration, found the calibration of a unit"),
        "{text}"
    );
    let of_type = concat!(env!("CARGO_MANIFEST_DIR"), "/../ema-identify/calibration/bench.toml");
    folder.write("type.toml", fs::read(of_type).expect("the shipped calibration"));
    folder.write("as_unit.toml", "[[actuator]]\nid = 0\ncalibration = \"type.toml\"\n");
    let text = folder.refused("check-config -c as_unit.toml", 78);
    assert!(
        text.contains("expected a unit's calibration, found the calibration of a type"),
        "{text}"
    );
}

#[test]
fn a_calibration_from_a_damaged_log_reports_what_was_lost() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --noise 0.05 --windows 6 --seed 3 -o healthy.log");
    let lines = String::from_utf8(folder.read("healthy.log")).expect("text");
    let mut lines: Vec<&str> = lines.lines().collect();
    lines[100] = "(1.0) rubbish";
    folder.write_lines("damaged.log", &lines);
    let ended = folder.hmd("calibrate damaged.log -o unit.toml");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    for expected in [
        "damaged.log:101: expected a stamp",
        "damaged.log: data lost: 1 unreadable lines or frames, ",
        "from 6 windows",
    ] {
        assert!(ended.stderr.contains(expected), "{expected} in\n{}", ended.stderr);
    }
    assert!(folder.path("unit.toml").exists());
    // Too little is left: half of it.
    folder.write_lines("half.log", &lines[..lines.len() / 2]);
    let ended = folder.hmd("calibrate half.log -o none.toml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    let last = ended.stderr.lines().last().expect("a sentence");
    assert!(
        last.contains("half.log: expected at least 5 windows that can be assessed, found "),
        "{last}"
    );
    assert!(!folder.path("none.toml").exists());
}

#[test]
fn a_unit_can_be_calibrated_under_the_configuration_that_names_the_result() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --noise 0.05 --windows 5 --seed 3 -o healthy.log");
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    folder.done("calibrate healthy.log -c hmd.toml -o unit.toml");
    let first = folder.read("unit.toml");
    folder.done("calibrate healthy.log -c hmd.toml -o unit.toml");
    assert_eq!(folder.read("unit.toml"), first, "not from what was learnt before");
    for line in [
        "calibrate healthy.log -o own.toml --actuator servo28",
        "calibrate healthy.log -o own.toml --monitor paper",
    ] {
        folder.misused(line);
    }
    folder.write("hmd.toml", "[type.bench]\ncalibration = \"bench.toml\"\n");
    folder.write("bench.toml", "read by the calibration of a unit");
    let text = folder.refused("calibrate healthy.log -c hmd.toml -o bench.toml", 2);
    assert!(text.contains("expected another output"), "{text}");
}

#[test]
fn the_demo_wears_out_in_order_and_its_forecast_converges() {
    let folder = Folder::new();
    let ended = folder.command("demo").output().expect("hmd starts");
    assert_eq!(ended.status.code(), Some(0));
    let text = String::from_utf8(ended.stdout).expect("text");
    let rows: Vec<&str> = text.lines().filter(|line| line.contains(" ema0 ")).collect();
    let mut states: Vec<&str> = rows
        .iter()
        .filter_map(|row| {
            ["nominal", "watch", "warning", "critical"]
                .into_iter()
                .find(|state| row.contains(state))
        })
        .collect();
    assert_eq!(states.len(), rows.len(), "every row has its state: {text}");
    states.dedup();
    assert_eq!(states, ["nominal", "watch", "warning", "critical"]);
    // Friction reaches 80 % at 0.8 / 0.75 of the hours shown.
    let hours = |row: &str| row.split_whitespace().next().and_then(|h| h.parse::<f64>().ok());
    let end = rows.last().and_then(|row| hours(row)).expect("hours") * 0.8 / 0.75;
    for row in &rows[rows.len() / 2..] {
        let now = hours(row).expect("hours");
        let left: f64 = row
            .split_whitespace()
            .nth(1)
            .and_then(|left| left.parse().ok())
            .expect("a forecast");
        assert!(
            (now + left - end).abs() < 0.1 * end,
            "{row}: expected the end at {end:.0} h"
        );
    }
}

#[test]
fn an_event_needs_a_place_and_a_known_actuator() {
    let folder = Folder::new();
    fs::write(folder.path("none.toml"), "").expect("a file");
    assert!(
        folder
            .refused("event --reset ema0 -c none.toml", 2)
            .contains("rul.events")
    );
    fs::write(folder.path("hmd.toml"), "[rul]\nevents = \"events.jsonl\"\n").expect("a file");
    assert!(folder.refused("event --reset nobody -c hmd.toml", 2).contains("nobody"));
    let output = folder
        .command("event --reset ema0 -c hmd.toml --at 5")
        .output()
        .expect("hmd starts");
    assert_eq!(output.status.code(), Some(0));
    let line = fs::read_to_string(folder.path("events.jsonl")).expect("the events");
    assert_eq!(line, "{\"t_ns\":5,\"actuator\":\"ema0\",\"event\":\"reset\"}\n");
    fs::write(folder.path("events.jsonl"), "nonsense\n").expect("a file");
    fs::write(folder.path("empty.log"), "").expect("a file");
    assert!(
        folder
            .refused("replay empty.log -c hmd.toml", 78)
            .contains("events.jsonl:1: expected a maintenance event")
    );
}

#[test]
fn a_recorded_history_is_shown_in_three_forms() {
    let folder = Folder::new();
    assert!(
        folder
            .command("demo -o life.mcap")
            .output()
            .expect("hmd starts")
            .status
            .success()
    );
    let shown = |options: &str| {
        let ended = folder
            .command(&format!("inspect life.mcap {options}"))
            .output()
            .expect("hmd starts");
        assert_eq!(ended.status.code(), Some(0));
        String::from_utf8(ended.stdout).expect("text")
    };
    let (table, json, csv) = (shown(""), shown("--json"), shown("--csv"));
    let windows = json.lines().count();
    assert!(windows > 10 && csv.lines().count() == windows + 1 && table.lines().count() == windows + 1);
    let last: serde_json::Value = serde_json::from_str(json.lines().last().expect("a line")).expect("JSON");
    assert_eq!(last["health"], "critical");
    assert_eq!(last["dominant_fault"], "friction");
    assert!(last["rul_h"]["p50"].is_f64() && last["damage"]["friction"].is_f64());
    let columns = |line: &str| line.split(',').count();
    assert!(
        csv.lines()
            .all(|line| columns(line) == columns(csv.lines().next().expect("a head")))
    );
    // Replay of the same frames says the same.
    let replayed = folder
        .command("replay life.mcap -c life.mcap.toml --json")
        .output()
        .expect("hmd starts");
    let replayed = String::from_utf8(replayed.stdout).expect("text");
    assert_eq!(replayed.lines().count(), windows);
    for (shown, replayed) in json.lines().zip(replayed.lines()) {
        let [shown, replayed]: [serde_json::Value; 2] =
            [shown, replayed].map(|line| serde_json::from_str(line).expect("JSON"));
        for key in ["window", "health", "rul_h", "rul_cycles"] {
            assert_eq!(shown[key], replayed[key], "{key}");
        }
    }
    folder.refused("inspect missing.mcap", 1);
    fs::write(folder.path("text.log"), "no log\n").expect("a file");
    assert!(
        folder
            .refused("inspect text.log", 1)
            .contains("expected records of windows")
    );
}

#[test]
fn no_verb_writes_over_what_it_reads_by_whatever_name() {
    let folder = Folder::new();
    folder.actuation();
    folder.done("replay actuation.log -o a.mcap");
    fs::hard_link(folder.path("a.mcap"), folder.path("hard.mcap")).expect("a link");
    fs::hard_link(folder.path("a.mcap"), folder.path("hard.csv")).expect("a link");
    fs::hard_link(folder.path("actuation.log"), folder.path("hard.log")).expect("a link");
    std::os::unix::fs::symlink("a.mcap", folder.path("soft.html")).expect("a link");
    let before = [folder.read("a.mcap"), folder.read("actuation.log")];
    for line in [
        "report a.mcap -o a.mcap",
        "report a.mcap -o soft.html",
        "recover a.mcap -o hard.mcap",
        "export a.mcap -o hard.csv",
        "calibrate actuation.log -o hard.log",
    ] {
        let text = folder.refused(line, 2);
        assert!(
            text.contains("expected another output than a file that is read"),
            "{line}: {text}"
        );
    }
    folder.refused("replay actuation.log -o hard.log", 2);
    assert_eq!([folder.read("a.mcap"), folder.read("actuation.log")], before);
    let config = "[rul]\nevents = \"events.jsonl\"\n[[actuator]]\nid = 0\nbus = \"can0\"\n";
    fs::create_dir(folder.path("conf.d")).expect("a folder");
    for (name, text) in [("hmd.toml", config), ("conf.d/a.toml", ""), ("events.jsonl", "\n")] {
        folder.write(name, text);
        folder.refused(&format!("replay actuation.log -c hmd.toml -o {name}"), 2);
        folder.refused(&format!("run -c hmd.toml --metrics {name} -o records/"), 2);
        assert_eq!(folder.read(name), text.as_bytes());
    }
    folder.refused("simulate -c hmd.toml -o hmd.toml", 2);
}

#[test]
fn a_bus_that_cannot_be_is_seen_by_the_check_of_the_configuration() {
    let folder = Folder::new();
    folder.write("hmd.toml", "[[actuator]]\nid = 0\nbus = \"a_name_too_long_0\"\n");
    let text = folder.refused("check-config -c hmd.toml", 78);
    assert!(text.contains("a_name_too_long_0"), "{text}");
    let many = (0..65).map(|n| format!("[[actuator]]\nid = 0\nname = \"a{n}\"\nbus = \"can{n}\""));
    folder.write_lines("hmd.toml", many);
    folder.refused("check-config -c hmd.toml", 78);
}

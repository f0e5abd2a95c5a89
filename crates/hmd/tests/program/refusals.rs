//! What `hmd` refuses before it reads anything: arguments, configurations and files, each in one sentence with its exit code.

use std::collections::BTreeMap;
use std::fs;

use crate::folder::{Folder, line_of_sample};

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
fn a_type_that_no_monitor_follows_is_not_calibrated() {
    let folder = Folder::new();
    // A speed loop a hundred times too stiff for its period chatters; one that is not damped swings.
    for (gains, expected) in [
        (
            "speed_proportional_gain_nm_s_per_rad = 40.0",
            "type own: expected a monitor whose quadrature current is off by at most 0.535 A rms, 5 % of the largest, found ",
        ),
        (
            "speed_proportional_gain_nm_s_per_rad = 0.004\nposition_gain_per_s = 1e5",
            "type own: expected a loop that comes to rest, found one whose output does not stay within 5 % of a step",
        ),
    ] {
        folder.write(
            "own.toml",
            format!("[type.own]\nbased_on = \"bench\"\n[type.own.controller]\n{gains}\n"),
        );
        let sentence = folder.refused("calibrate --type --actuator own -c own.toml -o own.calibration.toml", 1);
        assert!(sentence.contains(expected), "{gains}: {sentence}");
        assert!(!folder.path("own.calibration.toml").exists());
    }
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
        (
            "folder",
            "expected logs (.log, .mcap, .asc, .blf, .mf4, .csv, .parquet) in this folder, found none",
        ),
        (
            "empty.log",
            "expected a log of a format that is known (candump, MCAP, ASC, BLF, MF4, CSV, Parquet), found an empty file",
        ),
        (
            "text.log",
            "expected a log of a format that is known (candump, MCAP, ASC, BLF, MF4, CSV, Parquet), found no valid line in 2; the first: text.log:1: expected a stamp \
             \"(seconds.fraction)\" with 6 or 9 decimals, found \"Dear\"",
        ),
        (
            "zeros.log",
            "expected a log of a format that is known (candump, MCAP, ASC, BLF, MF4, CSV, Parquet), found binary data starting with \"\\x00",
        ),
        (
            "noise.mcap",
            "expected a log of a format that is known (candump, MCAP, ASC, BLF, MF4, CSV, Parquet), found no valid line in ",
        ),
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
    for time in ["1969-12-31T23:59Z", "2026-11-20", "9223372036854775808", "1700000004"] {
        let line = format!("event --reset ema0 -c hmd.toml --at {time}");
        assert!(
            folder
                .misused(&line)
                .contains("expected a time from 2000 on as 2026-11-20T14:00Z")
        );
    }
    let output = folder
        .command("event --reset ema0 -c hmd.toml --at 1600000000000000005")
        .output()
        .expect("hmd starts");
    assert_eq!(output.status.code(), Some(0));
    let output = folder
        .command("event --reset ema0 -c hmd.toml --at 2023-11-14T23:13+01:00 --note gearbox")
        .output()
        .expect("hmd starts");
    let noted = String::from_utf8(output.stdout).expect("text");
    assert_eq!(
        noted,
        "ema0: history reset from 2023-11-14 22:13 UTC on, with the next movement; noted in events.jsonl \
         (to withdraw it, delete that line before then)\n"
    );
    let lines = fs::read_to_string(folder.path("events.jsonl")).expect("the events");
    assert_eq!(
        lines,
        "{\"t_ns\":1600000000000000005,\"actuator\":\"ema0\",\"event\":\"reset\"}\n\
         {\"t_ns\":1699999980000000000,\"actuator\":\"ema0\",\"event\":\"reset\",\"note\":\"gearbox\"}\n"
    );
    fs::write(folder.path("events.jsonl"), "nonsense\n").expect("a file");
    fs::write(folder.path("empty.log"), "").expect("a file");
    assert!(
        folder
            .refused("replay empty.log -c hmd.toml", 78)
            .contains("events.jsonl:1: expected a maintenance event")
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

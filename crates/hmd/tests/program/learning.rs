//! The daemon learns a unit from its first windows, keeps what it learnt, and a replay learns the same.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::future::pending;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::ActuatorId;
use hmd::daemon::Daemon;
use hmd::replay::Replay;
use hmd_core::config::{Config, Limits};
use hmd_core::frame::{BusNames, RawFrame};
use hmd_ingest::feed::Input;
use hmd_ingest::live::LiveSource;
use hmd_lab::simulate::{EPOCH_NS, traffic};
use hmd_storage::calibration_file::{hash_of_models, hash_of_models_of_run};
use hmd_storage::config_file::load_config;
use hmd_storage::recorder::{Recorder, metadata};
use hmd_storage::segment_store::raw_segments;

use super::folder::Folder;
use super::lines::Lines;

pub(super) const SEED: u64 = 7;

/// A run over as many healthy actuations of a unit, recorded at `output`.
pub(super) fn run(config: &Arc<Config>, actuations: u32, output: &Path) -> (Vec<String>, Vec<String>) {
    let recorder = Recorder::create(output, &metadata(config, "test", SEED)).unwrap();
    run_from(EPOCH_NS, config, actuations, recorder)
}

/// Frames of so many healthy actuations of a unit, from a time on, UTC ns.
fn frames_from(from_ns: u64, actuations: u32) -> Vec<RawFrame> {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = 400.0;
    let scenario = Scenario {
        actuations: Actuations {
            count: actuations,
            ..Actuations::single(Profile::Mixed)
        },
        ..Scenario::new(params, FaultVector::NOMINAL, u64::from(actuations))
    };
    traffic(&scenario, ActuatorId::new(0).unwrap(), from_ns).collect()
}

/// The same as [`run`] from a time on, UTC ns.
pub(super) fn run_from(
    from_ns: u64,
    config: &Arc<Config>,
    actuations: u32,
    recorder: Recorder,
) -> (Vec<String>, Vec<String>) {
    let frames = frames_from(from_ns, actuations);
    let lines = Lines::default();
    let daemon = Daemon {
        sources: vec![(
            "can0".to_owned(),
            LiveSource::Playback(Box::new(frames.into_iter().map(Input::Frame))),
        )],
        recorder: Some(recorder),
        watch: Some((config.clone(), SEED)),
    };
    daemon.run(pending(), &lines).unwrap();
    (lines.health(), lines.notices())
}

pub(super) const CONFIG: &str = "[type.bench]\ntolerances = \"usual\"\n[type.bench.sensors]\nsample_rate_hz = 400\n\
    [[actuator]]\nid = 0\nbus = \"can0\"\nname = \"flap\"\nserial_number = \"S/7\"\nlearn_windows = 5\nlearn_folder = \"units\"\n";

#[test]
fn a_unit_is_learnt_kept_and_learnt_again_by_a_replay() {
    let folder = Folder::new();
    folder.write("hmd.toml", CONFIG);
    let config = Arc::new(load_config(folder.path("hmd.toml")).unwrap());
    let kept = folder.path("units").join("flap+S_7.unit.toml");

    let (health, notices) = run(&config, 7, &folder.path("first.mcap"));
    assert_eq!(health.len(), 7, "{health:#?}");
    for (n, line) in health.iter().enumerate() {
        let learning = line.contains(&format!("learning, {} of 5 windows", n + 1));
        let unknown = line.contains("\"health\":\"unknown\",\"faults\":[]");
        assert_eq!((learning, unknown), (n < 5, n < 5), "{line}");
    }
    let reported = notices
        .iter()
        .filter(|notice| notice.starts_with("flap: commissioned, "))
        .count();
    assert_eq!(reported, 1, "{notices:?}");
    let unit = std::fs::read(&kept).unwrap();

    // The hash of what windows are assessed with covers it.
    let (without, with) = (hash_of_models(&config), hash_of_models_of_run(&config));
    assert_ne!(without, with);
    folder.write(
        "named.toml",
        CONFIG.replace(
            "learn_windows = 5\nlearn_folder = \"units\"",
            "calibration = \"units/flap+S_7.unit.toml\"",
        ),
    );
    let named = load_config(folder.path("named.toml")).unwrap();
    assert_eq!(hash_of_models(&named), with);

    // A replay learns the same from the same windows, and neither reads nor writes what is kept.
    std::fs::write(&kept, "rubbish").unwrap();
    let lines = Lines::default();
    let replay = Replay {
        logs: &[folder.path("first.mcap")],
        output: None,
        config: config.clone(),
        seed: SEED,
    };
    replay.run(&mut &lines).unwrap();
    assert_eq!(lines.health(), health);
    assert_eq!(std::fs::read(&kept).unwrap(), b"rubbish");

    // A file that cannot be used is refused, not learnt anew from a unit that may be worn.
    let refused = folder.refused("check-config -c hmd.toml", 78);
    assert!(refused.contains("expected a unit's calibration"), "{refused}");

    // The next run goes on with what was learnt.
    std::fs::write(&kept, unit).unwrap();
    let (health, _) = run(&config, 2, &folder.path("second.mcap"));
    assert!(
        !health[0].contains("learning") && health[0].contains("\"faults\":[]"),
        "{}",
        health[0]
    );

    // Another unit has a file of its own.
    folder.write("hmd.toml", CONFIG.replace("S/7", "S8"));
    let config = Arc::new(load_config(folder.path("hmd.toml")).unwrap());
    let (health, _) = run(&config, 2, &folder.path("third.mcap"));
    assert!(health[1].contains("learning, 2 of 5 windows"), "{}", health[1]);
    // A file of another unit under its name is refused.
    std::fs::rename(&kept, folder.path("units").join("flap+S8.unit.toml")).unwrap();
    let refused = folder.refused("check-config -c hmd.toml", 78);
    assert!(
        refused.contains("expected the unit with serial number S8, found that with S/7"),
        "{refused}"
    );
}

#[test]
fn a_unit_that_cannot_be_commissioned_says_why_and_learning_goes_on() {
    let folder = Folder::new();
    folder.write(
        "hmd.toml",
        "[[actuator]]\nid = 0\nname = \"flap\"\nlearn_windows = 5\nlearn_folder = \"units\"\n",
    );
    folder.done("simulate --with inertia_deviation=0.6 --noise 0.03 --windows 6 --seed 3 -o far.log -c hmd.toml");
    let ended = folder.hmd("replay far.log -c hmd.toml --json");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    let sentence =
        "flap: not commissioned by 5 windows, learning goes on: type.bench.motor.inertia_kg_m2: expected 0.001";
    assert!(ended.stderr.contains(sentence), "{}", ended.stderr);
    let last = ended.stdout.lines().last().unwrap();
    assert!(
        last.contains("learning, 3 of 5 windows"),
        "the older half is dropped: {last}"
    );
    assert!(!folder.path("units").exists());
}

/// As by `hmd calibrate`: what a unit has when it is learnt would count as its health.
#[test]
fn a_worn_unit_is_not_learnt() {
    let folder = Folder::new();
    folder.write(
        "hmd.toml",
        "[[actuator]]\nid = 0\nname = \"flap\"\nlearn_windows = 5\nlearn_folder = \"units\"\n",
    );
    for (short, sentence) in [
        (
            0.4,
            "flap: not commissioned by 5 windows, learning goes on: expected windows in health, found inter-turn short, phase A",
        ),
        (0.25, "flap: warning: inter-turn short, phase A of 0.2"),
    ] {
        folder.done(&format!(
            "simulate --noise 0.03 --windows 6 --seed 5 --fault short_a={short} -o worn.log"
        ));
        let ended = folder.hmd("replay worn.log -c hmd.toml --json");
        assert!(ended.stderr.contains(sentence), "{}", ended.stderr);
        let is_learnt = ended.stderr.contains("flap: commissioned");
        assert_eq!(is_learnt, short < 0.3, "{}", ended.stderr);
    }
}

/// What is not kept would be learnt again after a restart, from a unit that may be worn by then.
#[test]
fn a_folder_that_nothing_can_be_kept_in_is_refused_or_told() {
    let folder = Folder::new();
    folder.write("file", "no folder");
    for place in ["/proc/x", "file"] {
        folder.write("hmd.toml", CONFIG.replace("\"units\"", &format!("{place:?}")));
        let refused = folder.refused("run -c hmd.toml -o segments/", if place == "file" { 78 } else { 1 });
        assert!(
            place == "file" || refused.contains("actuator.learn_folder of flap"),
            "{refused}"
        );
        assert!(!folder.path("segments").exists());
    }
    // It went bad meanwhile.
    folder.write("hmd.toml", CONFIG.replace("\"units\"", "\"/proc/x\""));
    let config = Arc::new(load_config(folder.path("hmd.toml")).unwrap());
    let (_, notices) = run(&config, 5, &folder.path("first.mcap"));
    let told = "the commissioning of flap is not kept: it is learnt again after a restart: /proc/x/flap+S_7.unit.toml: No such file";
    assert!(notices.iter().any(|notice| notice.starts_with(told)), "{notices:#?}");
}

#[test]
fn contradictory_settings_of_learning_are_refused() {
    let folder = Folder::new();
    for (lines, expected) in [
        ("learn_windows = 5", "learn_windows: expected learn_folder beside it"),
        (
            "learn_folder = \"units\"",
            "learn_folder: expected learn_windows beside it",
        ),
        (
            "learn_windows = 4\nlearn_folder = \"units\"",
            "learn_windows: expected a whole number from 5 to 20",
        ),
        (
            "calibration = \"unit.toml\"\nlearn_windows = 5\nlearn_folder = \"units\"",
            "learn_windows: expected either calibration or learn_windows",
        ),
    ] {
        folder.write("hmd.toml", format!("[[actuator]]\nid = 0\n{lines}\n"));
        let refused = folder.refused("check-config -c hmd.toml", 78);
        assert!(refused.contains(expected), "{refused}");
    }
}

#[test]
#[ignore = "long form: cargo xtask robust"]
fn a_type_is_made_of_several_units_and_replays() {
    let folder = Folder::new();
    let units = [(0.10, 0.2), (0.14, 0.35), (0.06, 0.05)];
    for (n, (inertia, friction)) in units.into_iter().enumerate() {
        folder.done(&format!(
            "simulate --with inertia_deviation={inertia} --with dynamic_friction_deviation={friction} --with \
             static_friction_deviation={friction} --noise 0.03 --windows 5 --seed {n} -o {n}.log"
        ));
        folder.done(&format!("calibrate {n}.log -o {n}.toml"));
    }
    let text = folder.refused("calibrate --type --units 0.toml 1.toml -o own.toml", 1);
    assert!(
        text.contains("expected the calibrations of at least 3 units, found 2"),
        "{text}"
    );
    let text = folder.refused(
        "calibrate --type --actuator servo28 --units 0.toml 1.toml 2.toml -o own.toml",
        1,
    );
    assert!(
        text.contains("expected a unit of type servo28, found one of type bench"),
        "{text}"
    );

    std::fs::create_dir(folder.path("conf.d")).unwrap();
    folder.done("calibrate --type --units 0.toml 1.toml 2.toml -o conf.d/own.toml");
    folder.write("hmd.toml", "[[actuator]]\nid = 0\n");
    let config = load_config(folder.path("hmd.toml")).unwrap();
    let (params, tolerances) = (&config.actuators()[0].params, &config.actuators()[0].tolerances);
    let near = |found: f64, expected: f64, within: f64| {
        assert!((found / expected - 1.0).abs() < within, "{found} instead of {expected}");
    };
    near(params.motor.j, 1.10e-3, 0.02);
    near(params.transmission.friction_dynamic, 0.15 * 1.2, 0.03);
    // Of three units: √(4/3) of their standard deviation.
    near(tolerances.j, 0.04 / 1.1 * (4.0_f64 / 3.0).sqrt(), 0.3);
    near(tolerances.friction_dynamic, 0.15 / 1.2 * (4.0_f64 / 3.0).sqrt(), 0.3);
    // The relations do not measure it.
    near(params.motor.r_s, ActuatorParams::bench().motor.r_s, 1e-9);
    let lines = folder.done("replay 0.log -c hmd.toml --json");
    assert_eq!(lines.lines().count(), 5, "{lines}");
    assert!(!lines.contains("friction\"]"), "{lines}");
    // Units are relative to the type's parameters.
    let text = folder.refused(
        "calibrate --type -c hmd.toml --units 0.toml 1.toml 2.toml -o again.toml",
        1,
    );
    assert!(text.contains("commission it again"), "{text}");
}

#[test]
fn the_page_of_a_commissioned_unit_needs_nothing_else() {
    let folder = Folder::new();
    folder.done("simulate --drive vector --noise 0.03 --windows 5 --seed 3 -o healthy.log");
    folder.done("calibrate healthy.log -o unit.toml --report unit.html");
    let page = String::from_utf8(folder.read("unit.html")).unwrap();
    for expected in [
        "<h1>Commissioning of ema0</h1>",
        "Smallest damage that shows",
        "Torque balance: measured and modelled",
        "T_d dry friction, Nm",
        "Apparent change of friction in healthy windows",
        "<li>speed mode</li>",
    ] {
        assert!(page.contains(expected), "{expected}");
    }
    for forbidden in ["<script", "<img", "http://", "https://", "NaN", "inf "] {
        assert!(!page.contains(forbidden), "{forbidden}");
    }
    folder.misused("calibrate healthy.log -o unit.toml --report healthy.log");
    folder.misused("calibrate healthy.log -o unit.toml --report unit.toml");
}

#[test]
fn what_was_learnt_of_a_unit_goes_with_it() {
    let folder = Folder::new();
    let without_number = CONFIG.replace("serial_number = \"S/7\"\n", "");
    folder.write(
        "hmd.toml",
        format!("[rul]\nstate = \"state\"\nevents = \"events.jsonl\"\n{without_number}"),
    );
    let config = Arc::new(load_config(folder.path("hmd.toml")).unwrap());
    let kept = folder.path("units").join("flap.unit.toml");
    run(&config, 5, &folder.path("first.mcap"));
    assert!(kept.exists());

    // Another unit came in its place.
    let reset = serde_json::json!({"t_ns": EPOCH_NS + 1, "actuator": "flap", "event": "reset"});
    folder.write("events.jsonl", format!("{reset}\n"));
    let (health, _) = run(&config, 2, &folder.path("second.mcap"));
    assert!(health[0].contains("learning, 1 of 5 windows"), "{}", health[0]);
    assert!(health[1].contains("learning, 2 of 5 windows"), "{}", health[1]);
    assert!(!kept.exists());
    let (health, _) = run(&config, 1, &folder.path("third.mcap"));
    assert!(health[0].contains("learning, 1 of 5 windows"), "{}", health[0]);
}

pub(super) const MINUTE_NS: u64 = 60_000_000_000;

/// Nothing but the times of the events and of the windows that it was learnt from says so: no history is kept.
#[test]
fn a_replacement_between_two_runs_voids_what_was_learnt_without_a_history() {
    let folder = Folder::new();
    folder.write("hmd.toml", format!("[rul]\nevents = \"events.jsonl\"\n{CONFIG}"));
    let config = Arc::new(load_config(folder.path("hmd.toml")).unwrap());
    let kept = folder.path("units").join("flap+S_7.unit.toml");
    run(&config, 5, &folder.path("learnt.mcap"));
    let unit = std::fs::read(&kept).unwrap();
    let reset = |t_ns: u64| serde_json::json!({"t_ns": t_ns, "actuator": "flap", "event": "reset"});
    let of_part = |part: &str| {
        let mut event = reset(EPOCH_NS + MINUTE_NS);
        event["part"] = part.into();
        event
    };
    for (event, is_void) in [
        // It was learnt from the unit that came with the first.
        (reset(EPOCH_NS), false),
        (reset(EPOCH_NS + 3 * MINUTE_NS), false),
        (reset(EPOCH_NS + MINUTE_NS), true),
        (of_part("motor"), true),
        (of_part("gearbox"), true),
        (of_part("controller"), true),
    ] {
        folder.write("events.jsonl", format!("{event}\n"));
        std::fs::write(&kept, &unit).unwrap();
        let recorder = Recorder::create(&folder.path("next.mcap"), &metadata(&config, "test", SEED)).unwrap();
        let (health, _) = run_from(EPOCH_NS + 2 * MINUTE_NS, &config, 2, recorder);
        assert_eq!(
            health[1].contains("learning, 2 of 5 windows"),
            is_void,
            "{event}: {}",
            health[1]
        );
        assert_eq!(kept.exists(), !is_void, "{event}");
    }
}

/// A run does not have the windows that the one before kept.
#[test]
fn a_replay_of_two_runs_learns_as_they_did() {
    let folder = Folder::new();
    folder.write("hmd.toml", CONFIG);
    let config = Arc::new(load_config(folder.path("hmd.toml")).unwrap());
    let segments = folder.path("segments");
    let mut live = Vec::new();
    for n in 0..2 {
        let limits = Limits::new(1_000_000, 3600, 1000, 0);
        let recorder = Recorder::open_folder(&segments, &metadata(&config, "test", SEED), limits).unwrap();
        let (health, _) = run_from(EPOCH_NS + n * MINUTE_NS, &config, 3, recorder);
        live.extend(health);
    }
    assert!(live[5].contains("learning, 3 of 5 windows"), "{}", live[5]);
    let entries = std::fs::read_dir(&segments).unwrap();
    let mut logs: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    logs.retain(|log| log.to_string_lossy().ends_with("-raw.mcap"));
    logs.sort();
    let lines = Lines::default();
    let replay = Replay {
        logs: &logs,
        output: None,
        config,
        seed: SEED,
    };
    replay.run(&mut &lines).unwrap();
    assert_eq!(lines.health(), live);
}

/// A capture lacks the windows that its unit was learnt from.
#[test]
fn a_capture_is_assessed_by_what_was_learnt_of_its_unit() {
    let folder = Folder::new();
    folder.write("hmd.toml", format!("{CONFIG}[rul]\nevents = \"events.jsonl\"\n"));
    let config = Arc::new(load_config(folder.path("hmd.toml")).unwrap());
    run(&config, 5, &folder.path("first.mcap"));
    let captured = |from_ns: u64, name: &str| {
        let about = metadata(&config, "test", SEED);
        let limits = Limits::new(1_000_000, 3600, 1000, 0);
        let mut recorder = Recorder::open_folder(&folder.path(name), &about, limits).unwrap();
        let mut names = BusNames::new();
        names.intern("can0").unwrap();
        recorder.begin_capture("asked for");
        for frame in frames_from(from_ns, 1) {
            recorder.write_frame(&frame, &names).unwrap();
        }
        recorder.finish().unwrap();
        let raw = raw_segments(&folder.path(name)).unwrap();
        raw.into_values().map(|raw| raw.path).collect::<Vec<_>>()
    };
    let replayed = |logs: &[PathBuf]| {
        let (lines, config) = (Lines::default(), config.clone());
        let replay = Replay {
            logs,
            output: None,
            config,
            seed: SEED,
        };
        replay.run(&mut &lines).unwrap();
        lines.health().remove(0)
    };
    let before = captured(EPOCH_NS - 2 * MINUTE_NS, "before");
    for logs in [&before, &captured(EPOCH_NS + MINUTE_NS, "after")] {
        let line = replayed(logs);
        assert!(!line.contains("learning") && line.contains("\"window\":0,"), "{line}");
    }
    // What was learnt is of another unit, and that of the capture was not learnt from what is left.
    folder.done(&format!("event --reset flap -c hmd.toml --at {}", EPOCH_NS - MINUTE_NS));
    let line = replayed(&before);
    let reason = "not learnt: the unit of this capture was learnt from windows that it lacks, and ";
    assert!(
        line.contains(reason) && line.contains("is that of another one"),
        "{line}"
    );
}

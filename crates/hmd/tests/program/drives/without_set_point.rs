//! Drives that tell no set point: motion begins a window.

use super::{Bus, count};
use crate::folder::Folder;

#[test]
fn without_set_point_motion_begins_a_window() {
    let bus = Bus {
        actuator: "servo270",
        preset: "moteus",
        encoder: true,
        rate_hz: 1000,
        keys: "output_encoder = 1\nset_point = false\ncurrent_bandwidth_hz = 500",
    };
    let folder = Folder::new();
    let said = bus.commission(&folder);
    assert!(said.contains("from 8 windows"), "{said}");
    assert!(said.contains("controller gain not shown by these windows"), "{said}");
    let healthy = bus.assessed(&folder, "--seed 3");
    assert_eq!(count(&healthy, "\"health\":\"nominal\",\"faults\":[]"), 2, "{healthy}");
    let friction = bus.assessed(&folder, "--seed 4 --fault friction=0.4");
    assert_eq!(count(&friction, "\"faults\":[\"friction\"]"), 2, "{friction}");
    let play = bus.assessed(&folder, "--seed 5 --fault backlash=0.4");
    assert_eq!(count(&play, "\"faults\":[\"backlash\"]"), 2, "{play}");
    let hidden = "no set point: motion begins a window, and controller gain is not observable";
    assert_eq!(count(&play, hidden), 2, "{play}");
    let filtered = "currents filtered at 500 Hz by the drive: faster ones are not seen";
    assert_eq!(count(&play, filtered), 2, "{play}");
    // A unit that is not known has nothing but the monitor, which follows a set point.
    let unknown = folder.done("replay later.log -c new.toml --json");
    assert_eq!(count(&unknown, "\"status\":\"invalid\""), 2, "{unknown}");
    assert_eq!(count(&unknown, "of a commissioned unit"), 2, "{unknown}");
}

/// A weak controller still creeps to its target when the next actuation begins.
#[test]
fn motion_that_begins_no_window_is_counted() {
    let folder = Folder::new();
    let kind = "[type.bench]\ndrive.kind = \"vector\"\nsensors.sample_rate_hz = 1000\n";
    let drive = "[actuator.drive]\npreset = \"moteus\"\noutput_encoder = 1\nset_point = false\n";
    folder.write("type.toml", kind);
    folder.write(
        "hmd.toml",
        format!("{kind}[[actuator]]\nid = 1\ntype = \"bench\"\n{drive}"),
    );
    folder.done(
        "simulate -c type.toml --rate 1000 --windows 5 --seed 5 --with inertia_deviation=0.04 --with dynamic_friction_deviation=0.15 \
         --with play_deviation=0.3 --fault gain=0.8 --preset moteus --output-encoder --id 1 -o weak.log",
    );
    let ended = folder.hmd("replay weak.log -c hmd.toml --json");
    let windows = count(&ended.stdout, "\"window\":");
    let said =
        "2 motions without a window: without set point one begins where the motor stood for 10 ms, and it did not";
    assert!(
        windows == 3 && ended.stderr.contains(said),
        "{windows}: {}",
        ended.stderr
    );
}

/// As `hmd calibrate` does, by the relations: no monitor follows a set point that is not there.
#[test]
fn a_unit_without_set_point_is_learnt() {
    let folder = Folder::new();
    let config = |settings: &str| {
        format!(
            "[type.servo270.sensors]\nsample_rate_hz = 1000\n[[actuator]]\nid = 1\nname = \"joint\"\nbus = \"can0\"\ntype = \"servo270\"\n\
             {settings}[actuator.drive]\npreset = \"moteus\"\noutput_encoder = 1\nset_point = false\n"
        )
    };
    folder.write("type.toml", config(""));
    folder.write("unit.toml", config("calibration = \"joint.toml\"\n"));
    folder.write("learn.toml", config("learn_windows = 6\nlearn_folder = \"units\"\n"));
    folder.done(
        "simulate --actuator servo270 --rate 1000 --noise 0.02 --id 1 --preset moteus --output-encoder --windows 8 --seed 3 \
         -o healthy.log -c type.toml",
    );
    folder.done("calibrate healthy.log -c type.toml -o joint.toml");
    let commissioned = folder.replayed("healthy.log -c unit.toml");
    let learnt = folder.replayed("healthy.log -c learn.toml");
    for (n, line) in learnt.iter().enumerate() {
        let learning = line["reason"]
            .as_str()
            .unwrap()
            .contains(&format!("learning, {} of 6 windows", n + 1));
        assert_eq!((learning, line["health"] == "unknown"), (n < 6, n < 6), "{line}");
    }
    assert_eq!(learnt[7]["status"], commissioned[7]["status"], "{}", learnt[7]);
    assert_eq!(learnt[7]["faults"], serde_json::json!([]), "{}", learnt[7]);
}

/// Of a drive whose current reads 0 A what is wrong with the windows is said.
#[test]
fn windows_without_set_point_that_are_not_fit_say_why() {
    let folder = Folder::new();
    folder.write(
        "hmd.toml",
        "[type.servo270.sensors]\nsample_rate_hz = 1000\n[[actuator]]\nid = 1\nname = \"joint\"\nbus = \"can0\"\ntype = \"servo270\"\n\
         [actuator.drive]\npreset = \"vesc\"\nset_point = false\n",
    );
    folder.done(
        "simulate --actuator servo270 --rate 1000 --noise 0.02 --id 1 --preset vesc --windows 5 --seed 3 -o whole.log -c hmd.toml",
    );
    let whole = String::from_utf8(folder.read("whole.log")).expect("a log of text");
    let without_current = |line: &str| match line.split_once("901#") {
        Some((before, data)) => format!("{before}901#{}0000{}\n", &data[..8], &data[12..]),
        None => format!("{line}\n"),
    };
    folder.write("dead.log", whole.lines().map(without_current).collect::<String>());
    let ended = folder.hmd("calibrate dead.log -c hmd.toml -o joint.toml");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert!(
        ended.stderr.contains("joint: window 0: left out: stuck: currents"),
        "{}",
        ended.stderr
    );
    assert!(!ended.stderr.contains("(hmd calibrate)"), "{}", ended.stderr);
}

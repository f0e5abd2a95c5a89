//! What `hmd check-config` says of a configuration.

use super::{OF_DBC, read};

/// The lines of a description that begin like this, blanks in front apart.
fn lines(text: &str, beginning: &str) -> Vec<String> {
    let description = read(text).describe();
    let all = description.lines().map(|line| line.trim_start().to_owned());
    all.filter(|line| line.starts_with(beginning)).collect()
}

#[test]
fn a_mapped_bus_is_described_by_messages_and_by_what_it_lacks() {
    let text = OF_DBC.replace("status.load_torque = \"ACE1_Phase.M_load\"\n", "");
    let description = read(&text).describe();
    let expected = "  ema0: number 0 on can0, type bench with hysteresis drive at 400 Hz
    mapped by foreign.dbc:
    ACE1_Phase 2C0: currents.a currents.b currents.c status.dc_link status.winding_temp sample.counter of 6 bits
    ACE1_Angles 18FEF100: position.motor position.output sample.counter of 8 bits
    ACE1_Demand 2C1: command.position command.mode sample.time
    ACE1_Demand has no counter: its frames join a sample by their stamps, at most 1.25 ms apart
    no status.load_torque: it is an unknown of every window
bus load: can0 25 % of 1000000 bit/s
";
    assert!(description.contains(expected), "{description}");
    assert!(lines(OF_DBC, "no ").is_empty());
    let text = text.replace("currents.c = \"ACE1_Phase.I_C\"\n", "");
    assert_eq!(
        lines(&text, "no "),
        [
            "no currents.c: it is what the other two leave",
            "no status.load_torque: it is an unknown of every window"
        ]
    );
}

#[test]
fn a_drive_and_a_log_are_described_by_columns_and_gaps() {
    let drive = |keys: &str| {
        let text = format!(
            "[[actuator]]\nid = 1\nbus = \"can0\"\n[actuator.drive]\n{keys}\n[type.bench]\nsensors.sample_rate_hz = 400\n"
        );
        read(&text).describe()
    };
    let odrive = drive("preset = \"odrive\"");
    let expected = "    odrive node 1, listened to: time \"stamp\" command.mode \"mode\" \
                    position.motor \"Get_Encoder_Estimates.Pos_Estimate\"";
    assert!(odrive.contains(expected), "{odrive}");
    assert!(
        odrive.contains("\n    no currents.d: it is taken as 0, and shorts are not observable\n"),
        "{odrive}"
    );
    let waits = drive("preset = \"cia402\"");
    assert!(
        waits.contains("\n    ema1: waits until its master writes the PDO: expected "),
        "{waits}"
    );
    let log = read("[map]\ntime = \"t\"\ncurrents.q = \"iq\"\nposition.motor = \"m\"\n").describe();
    let expected = "    ema0, of logs: time \"t\" currents.q \"iq\" position.motor \"m\"\n    currents of d and q: ";
    assert!(log.contains(expected), "{log}");
}

#[test]
fn a_unit_is_described_with_its_calibrations_and_numbers() {
    let text = "[[actuator]]\nid = 1\ncalibration = \"unit.toml\"\npart_number = \"P1\"\n[type.bench]\ncalibration = \"type.toml\"\n";
    let expected = "ema1: number 1 on any bus, type bench with hysteresis drive at 2000 Hz, type calibrated by type.toml, \
                    unit calibrated by unit.toml, part P1";
    assert_eq!(lines(text, "ema1"), [expected]);
}

#[test]
fn the_search_is_described_with_what_bounds_it() {
    let of = |keys: &str| lines(&format!("[identification]\n{keys}"), "identification");
    assert_eq!(
        of(""),
        ["identification: hybrid with the three-phase monitor, population 32, generations 5, at most 5000 evaluations"]
    );
    assert_eq!(
        of("method = \"ga\"\nobjective = \"eq14\"\nmonitor = \"paper\""),
        [
            "identification: ga with the paper monitor, objective eq14, population 200, generations 800, at most 200000 evaluations"
        ]
    );
    assert_eq!(
        of("method = \"least-squares\""),
        ["identification: least-squares with the three-phase monitor"]
    );
}

#[test]
fn windows_hours_and_frames_are_described() {
    assert_eq!(
        lines("[window]\nmax_gap_fraction = 0.01", "window"),
        [
            "window: 500 ms, 20 ms of it before the trigger; invalid above 1 % missing samples (5 % if scattered) or a gap of 5 ms"
        ]
    );
    assert_eq!(
        lines(
            "[rul]\nhours = \"elapsed\"\nwarning_h = 20\nstate = \"units\"\nevents = \"e.jsonl\"",
            "remaining"
        ),
        [
            "remaining life: elapsed hours, horizon 100 h, warning below 20 h, critical below 0 h, state in units, events in e.jsonl"
        ]
    );
    let frames = |keys: &str| lines(&format!("[output]\n{keys}"), "raw frames");
    assert_eq!(frames(""), ["raw frames: stored"]);
    assert_eq!(
        frames("raw_frames = false\ncaptures = false"),
        ["raw frames: not stored"]
    );
    let [captured] = &frames("raw_frames = false")[..] else {
        panic!()
    };
    assert!(
        captured.starts_with("raw frames: in a folder, those from 2 s before to 1 s behind windows"),
        "{captured}"
    );
}

#[test]
fn levels_are_described_once_for_all_faults_and_for_each_that_differs() {
    let most =
        "health, every fault: watch 0.05, warning 0.3, critical 0.6, end of life 0.8, hysteresis 0.02, persistence 1";
    assert_eq!(lines("", "health"), [most]);
    let of_gain =
        "health, except gain: watch 0.05, warning 0.3, critical 0.6, end of life 0.8, hysteresis 0.02, persistence 4";
    assert_eq!(lines("[health.fault.gain]\npersistence = 4", "health"), [most, of_gain]);
}

#[test]
fn parameters_are_described_with_their_tolerance_and_where_each_comes_from() {
    let text = "[type.own]\nbased_on = \"servo270\"\n[type.own.motor]\ninertia_kg_m2 = 1.23456789e-4\n\
                cogging_tolerance = 0.01\n[type.own.controller]\nspeed_max_rad_s = 1234.56789\n";
    let description = read(text).describe();
    for line in [
        "type own:",
        "  motor.inertia_kg_m2 1.23457e-4 ± 0.05 of it (hmd.toml:4, usual)",
        "  motor.pole_pairs ",
        "  motor.cogging ± 0.01 (hmd.toml:5)",
        "  controller.speed_max_rad_s 1234.57 ± ",
    ] {
        assert!(description.contains(&format!("\n{line}")), "{line}\n{description}");
    }
    // Those that are neither used nor described are not listed.
    let types: Vec<_> = description.lines().filter(|line| line.starts_with("type ")).collect();
    assert_eq!(types, ["type bench:", "type own:"]);
}

#[test]
fn without_actuators_it_says_how_many_fit_on_one_bus() {
    let text = "[type.bench.sensors]\nsample_rate_hz = 400\n";
    assert_eq!(
        lines(text, "bus load"),
        ["bus load: 15 % of 1000000 bit/s by each at 400 Hz, so 6 fit on one bus"]
    );
}

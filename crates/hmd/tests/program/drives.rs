//! Drives as they are sold, simulated frame by frame from their published dictionaries, commissioned and assessed by the program.

mod without_set_point;

use crate::folder::Folder;

/// A bus: type of actuator, preset, whether there is an encoder at the output, rate in Hz, further keys of the drive.
struct Bus {
    actuator: &'static str,
    preset: &'static str,
    encoder: bool,
    rate_hz: u32,
    keys: &'static str,
}

impl Bus {
    /// Writes `NAME.toml`; `calibration` is that of the unit.
    fn configure(&self, folder: &Folder, name: &str, calibration: &str) {
        let Self {
            actuator,
            preset,
            rate_hz,
            keys,
            ..
        } = self;
        let head = format!("[[actuator]]\nid = 1\nname = \"joint\"\ntype = \"{actuator}\"\n{calibration}");
        let drive = format!("[actuator.drive]\npreset = \"{preset}\"\n{keys}\n");
        let kind = format!("[type.{actuator}]\nbased_on = \"{actuator}\"\nsensors.sample_rate_hz = {rate_hz}\n");
        folder.write(&format!("{name}.toml"), format!("{head}{drive}{kind}"));
    }

    fn simulate(&self, folder: &Folder, options: &str, log: &str) {
        let Self {
            actuator,
            preset,
            rate_hz,
            ..
        } = self;
        let encoder = if self.encoder { "--output-encoder" } else { "" };
        folder.done(&format!(
            "simulate --actuator {actuator} --rate {rate_hz} --noise 0.02 --id 1 --preset {preset} {encoder} {options} -o {log}"
        ));
    }

    /// Commissions the unit by eight windows; the configuration that knows it is `known.toml`.
    fn commission(&self, folder: &Folder) -> String {
        folder.write("drive.dcf", include_str!("../../../../fixtures/drives/drive.dcf"));
        folder.write("drive.eds", include_str!("../../../../fixtures/drives/drive.eds"));
        self.configure(folder, "new", "");
        self.simulate(folder, "--windows 8 --seed 30", "healthy.log");
        let ended = folder.hmd("calibrate healthy.log -c new.toml -o unit.toml");
        assert_eq!(ended.code, 0, "{}", ended.stderr);
        self.configure(folder, "known", "calibration = \"unit.toml\"\n");
        ended.stderr
    }

    /// The lines of two windows with a fault.
    fn assessed(&self, folder: &Folder, options: &str) -> String {
        self.simulate(folder, &format!("--windows 2 {options}"), "later.log");
        let lines = folder.done("replay later.log -c known.toml --json");
        assert_eq!(lines.lines().count(), 2, "{lines}");
        lines
    }
}

fn count(lines: &str, what: &str) -> usize {
    lines.matches(what).count()
}

#[test]
#[ignore = "long form: cargo xtask robust"]
fn friction_and_play_are_named_where_the_output_is_measured() {
    for (preset, keys) in [
        ("odrive", "output_encoder = 490"),
        ("moteus", "output_encoder = 1"),
        ("cia402", "eds = \"drive.dcf\"\noutput_encoder = 1"),
    ] {
        let (encoder, rate_hz) = (true, 400);
        let bus = Bus {
            actuator: "servo270",
            preset,
            encoder,
            rate_hz,
            keys,
        };
        let folder = Folder::new();
        bus.commission(&folder);
        let healthy = bus.assessed(&folder, "--seed 3");
        assert_eq!(
            count(&healthy, "\"health\":\"nominal\",\"faults\":[]"),
            2,
            "{preset}: {healthy}"
        );
        let friction = bus.assessed(&folder, "--seed 4 --fault friction=0.4");
        assert_eq!(count(&friction, "\"faults\":[\"friction\"]"), 2, "{preset}: {friction}");
        let play = bus.assessed(&folder, "--seed 5 --fault backlash=0.4");
        assert_eq!(count(&play, "\"faults\":[\"backlash\"]"), 2, "{preset}: {play}");
        let shorts = "no currents.d: it is taken as 0, and shorts are not observable";
        let hidden = if preset == "moteus" { 0 } else { 2 };
        assert_eq!(count(&healthy, shorts), hidden, "{preset}: {healthy}");
    }
}

#[test]
fn without_an_encoder_at_the_output_play_is_not_observable() {
    for (preset, keys) in [
        ("odrive", ""),
        ("moteus", ""),
        ("cia402", "eds = \"drive.dcf\""),
        (
            "damiao",
            "rated_current_a = 10\nposition_max_rad = 1\nfeedback_id = 0x11",
        ),
    ] {
        let (encoder, rate_hz) = (false, 400);
        let bus = Bus {
            actuator: "servo270",
            preset,
            encoder,
            rate_hz,
            keys,
        };
        let folder = Folder::new();
        let play = "--seed 5 --fault backlash=0.4";
        let is_commissioned = preset == "damiao";
        let play = if is_commissioned {
            let said = bus.commission(&folder);
            assert!(said.contains("backlash not shown by these windows"), "{preset}: {said}");
            let friction = bus.assessed(&folder, "--seed 4 --fault friction=0.4");
            assert_eq!(count(&friction, "\"faults\":[\"friction\"]"), 2, "{friction}");
            bus.assessed(&folder, play)
        } else {
            // Before it is commissioned, which takes most of the time.
            bus.configure(&folder, "known", "");
            folder.write("drive.dcf", include_str!("../../../../fixtures/drives/drive.dcf"));
            bus.assessed(&folder, play)
        };
        assert_eq!(count(&play, "\"faults\":[]"), 2, "{preset}: {play}");
        let hidden = "no position.output: the gear is taken as rigid, and backlash is not observable";
        assert_eq!(count(&play, hidden), 2, "{preset}: {play}");
        // Friction, then backlash; a commissioned unit shows its friction.
        let [shown, hidden] = [true, false].map(|friction| count(&play, &format!("\"observable\":[{friction},false,")));
        assert_eq!(shown + hidden, 2, "{preset}: {play}");
        assert!(!is_commissioned || hidden == 0, "{preset}: {play}");
    }
}

/// A position in steps of a hundredth of the motor's turn is coarser than any encoder.
#[test]
fn a_healthy_unit_behind_coarse_fields_is_modelled_before_it_is_commissioned() {
    let bus = Bus {
        actuator: "servo270",
        preset: "damiao",
        encoder: false,
        rate_hz: 400,
        keys: "rated_current_a = 10\nposition_max_rad = 1\nfeedback_id = 0x11",
    };
    let folder = Folder::new();
    bus.configure(&folder, "new", "");
    let assessed = |options: &str| {
        bus.simulate(&folder, options, "new.log");
        folder.done("replay new.log -c new.toml --json")
    };
    for profile in ["mixed", "step", "ramp"] {
        let healthy = assessed(&format!("--windows 4 --seed 30 --profile {profile}"));
        assert_eq!(count(&healthy, "\"status\":\"degraded\""), 4, "{profile}: {healthy}");
        assert_eq!(count(&healthy, "\"faults\":[]"), 4, "{profile}: {healthy}");
    }
    let eccentric = assessed("--windows 2 --seed 30 --fault eccentricity=0.3");
    assert_eq!(count(&eccentric, "\"faults\":[\"eccentricity\"]"), 2, "{eccentric}");
}

#[test]
fn a_current_by_power_and_voltage_in_coarse_steps_is_assessed() {
    let bus = Bus {
        actuator: "bench",
        preset: "vesc",
        encoder: false,
        rate_hz: 1000,
        keys: "set_point = false",
    };
    let folder = Folder::new();
    let said = bus.commission(&folder);
    assert!(said.contains("from 8 windows"), "{said}");
    // A step of the current is nearly what friction takes.
    assert!(said.contains("smallest damage that shows: friction 0.3"), "{said}");
    for fault in ["", "backlash"] {
        let fault = if fault.is_empty() {
            String::new()
        } else {
            format!("--fault {fault}=0.4")
        };
        let lines = bus.assessed(&folder, &format!("--seed 3 {fault}"));
        assert_eq!(count(&lines, "\"faults\":[]"), 2, "{fault}: {lines}");
    }
    let eccentric = bus.assessed(&folder, "--seed 4 --fault eccentricity=0.4");
    assert_eq!(count(&eccentric, "\"faults\":[\"eccentricity\"]"), 2, "{eccentric}");
    let friction = bus.assessed(&folder, "--seed 4 --fault friction=0.6");
    assert!(friction.contains("\"faults\":[\"friction\"]"), "{friction}");
}

#[test]
fn the_pdo_are_those_that_the_master_wrote() {
    let bus = |keys| Bus {
        actuator: "servo270",
        preset: "cia402",
        encoder: true,
        rate_hz: 400,
        keys,
    };
    let folder = Folder::new();
    let of_dcf = bus("eds = \"drive.dcf\"\noutput_encoder = 1");
    of_dcf.commission(&folder);
    of_dcf.simulate(&folder, "--seed 4", "later.log");
    let expected = folder.done("replay later.log -c new.toml --json");
    // The file's defaults are others; no file at all, with the scales in the configuration.
    for keys in [
        "eds = \"drive.eds\"\noutput_encoder = 1",
        "output_encoder = 1\nmotor_units_per_rev = 65536\noutput_units_per_rev = 20000\nrated_current_a = 5.656854249492381",
    ] {
        bus(keys).configure(&folder, "other", "");
        let described = folder.done("check-config -c other.toml");
        assert!(
            described.contains("joint: waits until its master writes the PDO"),
            "{described}"
        );
        assert_eq!(folder.done("replay later.log -c other.toml --json"), expected, "{keys}");
    }
    // Without what the master wrote nothing is known.
    let log = String::from_utf8(folder.read("later.log")).expect("text");
    let kept = log
        .lines()
        .filter(|line| !line.contains(" 601#") && !line.contains(" 581#"));
    folder.write("cut.log", &(kept.collect::<Vec<_>>().join("\n") + "\n"));
    assert_eq!(folder.done("replay cut.log -c new.toml --json"), expected);
    bus("output_encoder = 1").configure(&folder, "bus", "");
    assert_eq!(
        folder.done("replay cut.log -c bus.toml --eds drive.dcf --json"),
        expected
    );
    let refused = folder.hmd("replay cut.log -c other.toml");
    assert_eq!(refused.code, 1);
    let said = "joint: not monitored: expected a PDO in use (1400 to 1BFF), from the EDS file or overheard, where there is none";
    assert!(refused.stderr.contains(said), "{}", refused.stderr);
}

#[test]
fn what_a_bus_never_says_is_said() {
    let folder = Folder::new();
    let bus = Bus {
        actuator: "servo270",
        preset: "odrive",
        encoder: false,
        rate_hz: 400,
        keys: "",
    };
    bus.configure(&folder, "hmd", "");
    bus.simulate(&folder, "--windows 1 --seed 4", "joint.log");
    let log = String::from_utf8(folder.read("joint.log")).expect("text");
    for (frames, said) in [
        // Get_Iq; Set_Input_Pos.
        (
            " 034#",
            "joint: not monitored: expected Get_Iq.Iq_Measured (identifier 034) in each sample, found none\n",
        ),
        (
            " 02C#",
            "the mode was never on; the set point of a drive is overheard: without it, set_point = false begins windows by motion",
        ),
    ] {
        folder.write_lines("cut.log", log.lines().filter(|line| !line.contains(frames)));
        let ended = folder.hmd("replay cut.log -c hmd.toml");
        assert!(ended.stderr.contains(said), "{}", ended.stderr);
    }
}

#[test]
fn identifiers_that_came_instead_are_named() {
    let (actuator, rate_hz) = ("servo270", 400);
    for (preset, encoder, keys, said) in [
        (
            "odrive",
            true,
            "output_encoder = 491",
            "joint: not monitored: expected TxSdo.Value (identifier 025, number 491) in each sample, found none, but identifiers that \
             are not read: 024; 025, number 490\n",
        ),
        (
            "damiao",
            false,
            "rated_current_a = 10\nposition_max_rad = 1",
            "joint: not monitored: expected POS (identifier 000, number 1), T (identifier 000, number 1) in each sample, found none, \
             but identifiers that are not read: 011\n",
        ),
    ] {
        let folder = Folder::new();
        let bus = Bus {
            actuator,
            preset,
            encoder,
            rate_hz,
            keys,
        };
        bus.configure(&folder, "hmd", "");
        bus.simulate(&folder, "--windows 1 --seed 4", "joint.log");
        for command in [
            "replay joint.log -c hmd.toml",
            "calibrate joint.log -c hmd.toml -o unit.toml",
        ] {
            let ended = folder.hmd(command);
            assert_eq!(ended.code, 1, "{command}");
            assert!(ended.stderr.contains(said), "{command}: {}", ended.stderr);
            assert!(!ended.stderr.contains("0 frames with"), "{command}: {}", ended.stderr);
        }
    }
}

#[test]
fn what_is_wrong_with_a_drive_is_said() {
    let folder = Folder::new();
    folder.write("bad.eds", "[1A00sub1]\nDefaultValue=many\n");
    let sentence = |drive: &str| {
        folder.write("hmd.toml", format!("[[actuator]]\nid = 0\n[actuator.drive]\n{drive}\n"));
        let ended = folder.hmd("check-config -c hmd.toml");
        assert_eq!(ended.code, 78, "{}", ended.stderr);
        ended.stderr.trim_end().to_owned()
    };
    for (drive, expected) in [
        (
            "",
            "hmd: hmd.toml:3: actuator[0].drive.preset: expected one of cia402, odrive, moteus, vesc, damiao, found no such key",
        ),
        (
            "preset = \"sevcon\"",
            "hmd: hmd.toml:4: actuator[0].drive.preset: expected \"cia402\" or \"odrive\" or \"moteus\" or \"vesc\" or \"damiao\", \
             found \"sevcon\"",
        ),
        (
            "preset = \"odrive\"\nnode = 63",
            "hmd: hmd.toml:5: actuator[0].drive.node: expected a whole number from 0 to 62, found 63",
        ),
        (
            "preset = \"cia402\"",
            "hmd: hmd.toml:3: actuator[0].drive.node: expected a number from 1 to 127, found 0 (that of the actuator)",
        ),
        (
            "preset = \"damiao\"\nnode = 1",
            "hmd: hmd.toml:3: actuator[0].drive: expected rated_current_a, the peak of i_q at TMAX, in [actuator.drive] or, of CiA \
             402, in the EDS file, found none",
        ),
        (
            "preset = \"vesc\"\noutput_encoder = 1",
            "hmd: hmd.toml:5: actuator[0].drive.output_encoder: expected no such key, which is of preset cia402, odrive, moteus, \
             found 1",
        ),
        (
            "preset = \"odrive\"\neds = \"bad.eds\"",
            "hmd: hmd.toml:5: actuator[0].drive.eds: expected no such key, which is of preset cia402, found \"bad.eds\"",
        ),
        (
            "preset = \"cia402\"\nnode = 1\neds = \"bad.eds\"",
            "hmd: hmd.toml:6: actuator[0].drive.eds: expected an EDS or DCF file that can be read (line 2: expected a whole \
             number, or $NODEID + a whole number, found \"DefaultValue=many\"), found \"bad.eds\"",
        ),
    ] {
        assert_eq!(sentence(drive), expected);
    }
}

/// One SYNC is for all drives of a bus, and several motors may answer their master with one identifier.
#[test]
fn each_of_two_drives_on_a_bus_is_heard() {
    for (preset, keys) in [
        ("cia402", "eds = \"drive.dcf\""),
        (
            "damiao",
            "rated_current_a = 10\nposition_max_rad = 1\nfeedback_id = 0x11",
        ),
    ] {
        let folder = Folder::new();
        folder.write("drive.dcf", include_str!("../../../../fixtures/drives/drive.dcf"));
        let mut lines = Vec::new();
        let mut config = "[type.servo270]\nsensors.sample_rate_hz = 400\n".to_owned();
        for id in [1, 2] {
            folder.done(&format!(
                "simulate --actuator servo270 --rate 400 --noise 0.02 --id {id} --preset {preset} --seed {id} -o {id}.log"
            ));
            let log = String::from_utf8(folder.read(&format!("{id}.log"))).expect("text");
            let is_first_sync = |line: &&str| id == 1 || !line.contains(" 080#");
            lines.extend(log.lines().filter(is_first_sync).map(str::to_owned));
            config += &format!(
                "[[actuator]]\nid = {id}\nname = \"joint{id}\"\ntype = \"servo270\"\n[actuator.drive]\npreset = \"{preset}\"\n{keys}\n"
            );
        }
        lines.sort_by(|a, b| a.split(')').next().cmp(&b.split(')').next()));
        folder.write("both.log", lines.join("\n") + "\n");
        folder.write("both.toml", config);
        let windows = folder.done("replay both.log -c both.toml --json");
        for name in ["joint1", "joint2"] {
            assert_eq!(
                count(&windows, &format!("\"actuator\":\"{name}\"")),
                1,
                "{preset}: {windows}"
            );
        }
    }
}

/// Nothing counts their samples, and no stamp tells a pause between two logs from loss.
#[test]
fn a_pause_between_the_logs_of_a_drive_is_no_loss() {
    let folder = Folder::new();
    folder.write(
        "hmd.toml",
        "[type.servo270.sensors]\nsample_rate_hz = 400\n[[actuator]]\nid = 1\nname = \"joint\"\nbus = \"can0\"\ntype = \"servo270\"\n\
         [actuator.drive]\npreset = \"moteus\"\noutput_encoder = 1\n",
    );
    for (name, start) in [
        ("a", "2026-11-20T14:00Z"),
        ("b", "2026-11-20T14:01Z"),
        ("c", "2026-11-21T14:01Z"),
    ] {
        folder.done(&format!(
            "simulate --actuator servo270 --rate 400 --id 1 --preset moteus --output-encoder --start {start} -o {name}.log -c hmd.toml"
        ));
    }
    let lines = folder.done("replay a.log b.log c.log -c hmd.toml --json");
    assert_eq!(lines.lines().count(), 3, "{lines}");
    // In one log the frames between are lost.
    let both = [folder.read("a.log"), folder.read("b.log")].concat();
    folder.write("both.log", both);
    let ended = folder.hmd("replay both.log -c hmd.toml");
    assert!(ended.code == 3 && ended.stderr.contains("samples"), "{}", ended.stderr);
}

#[test]
fn another_node_is_named_and_frames_of_the_built_in_dictionary_are_none_of_a_drive() {
    for preset in ["odrive", "moteus", "vesc"] {
        let bus = Bus {
            actuator: "servo270",
            preset,
            encoder: false,
            rate_hz: 400,
            keys: "node = 5",
        };
        let folder = Folder::new();
        bus.configure(&folder, "known", "");
        let head = format!("expected frames of joint on any bus ({preset} node 5), found none (");
        bus.simulate(&folder, "--windows 1", "node.log");
        let message = folder.refused("replay node.log -c known.toml", 1);
        assert!(message.contains(&head), "{message}");
        assert!(
            message.contains(" other frames of node 1 on can0)") && !message.contains("malformed"),
            "{message}"
        );
        folder.done("simulate --id 1 --windows 1 -o other.log");
        let message = folder.refused("replay other.log -c known.toml", 1);
        assert!(message.contains(&head) && !message.contains("malformed"), "{message}");
    }
}

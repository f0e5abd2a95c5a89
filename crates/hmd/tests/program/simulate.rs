//! `hmd simulate` with effects of real actuators: by name, from a file, in speed mode, and without any.

use ema_models::reference::EFFECTS;
use serde_json::{Value, json};

use crate::folder::Folder;

/// FNV-1a.
fn hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// The lines of a truth file.
fn truth(folder: &Folder, log: &str) -> Vec<Value> {
    let text = String::from_utf8(folder.read(&format!("{log}.truth.jsonl"))).expect("text");
    let lines = text.lines().map(serde_json::from_str);
    lines.collect::<Result<_, _>>().expect("lines of JSON")
}

/// The hashes are those of the program of commit de39b47, which knew no effects.
#[test]
fn without_effects_log_and_truth_keep_their_bytes() {
    let folder = Folder::new();
    for (actuator, expected) in [("bench", 0x44fd_fa7e_5cc3_9244_u64), ("servo28", 0x84e9_3cc3_627c_bbca)] {
        folder.done(&format!(
            "simulate -o plain.log --actuator {actuator} --rate 400 --windows 2 --noise 0.05 --fault friction=0.2 \
             --fault short_b=0.1 --fault eccentricity=0.3 --load 3 --seed 9"
        ));
        let log = hash(&folder.read("plain.log"));
        assert_eq!(log, expected, "{actuator}: 0x{log:016x}");
        let truth = hash(&folder.read("plain.log.truth.jsonl"));
        assert_eq!(truth, 0x6c39_7d4f_ffc4_d53c, "{actuator}: 0x{truth:016x}");
    }
}

#[test]
fn the_truth_says_what_was_on_and_can_be_simulated_again() {
    let folder = Folder::new();
    folder.done(
        "simulate -o line.log --rate 400 --windows 2 --drive vector --with dead_time_s=1.5e-6 --with cogging_nm=0.05",
    );
    let lines = truth(&folder, "line.log");
    assert_eq!(lines.len(), 2);
    let first = &lines[0];
    assert_eq!(
        (&first["drive"], &first["effects"]),
        (&json!("vector"), &lines[1]["effects"])
    );
    let effects = first["effects"].as_object().expect("names and values");
    assert_eq!(
        (&effects["dead_time_s"], &effects["cogging_nm"]),
        (&json!(1.5e-6), &json!(0.05))
    );
    // The vector drive has all its parameters in the truth.
    assert!(
        effects.contains_key("decoupling") && !effects.contains_key("emf_5"),
        "{effects:?}"
    );

    let file: String = effects
        .iter()
        .map(|(name, value)| format!("{name} = {value}\n"))
        .collect();
    folder.write("unit.toml", format!("drive = \"vector\"\n{file}"));
    folder.done("simulate -o file.log --rate 400 --windows 2 --effects unit.toml");
    assert!(folder.read("file.log") == folder.read("line.log"));
    assert!(folder.read("file.log.truth.jsonl") == folder.read("line.log.truth.jsonl"));

    // An option holds over the file.
    folder.done("simulate -o over.log --rate 400 --effects unit.toml --with cogging_nm=0.1");
    assert_eq!(truth(&folder, "over.log")[0]["effects"]["cogging_nm"], json!(0.1));
    let sentence = folder.refused("simulate -o no.log --effects unit.toml --drive hysteresis", 2);
    assert!(
        sentence.ends_with(": expected the vector drive, found the hysteresis drive"),
        "{sentence}"
    );
}

#[test]
fn each_effect_can_be_on_by_its_name() {
    let folder = Folder::new();
    let mut file = "drive = \"vector\"\n".to_owned();
    for info in EFFECTS {
        file += &format!("{} = {}\n", info.name, info.usual.1);
    }
    folder.write("all.toml", file);
    folder.done("simulate -o all.log --rate 400 --fault short_a=0.2 --effects all.toml");
    let lines = truth(&folder, "all.log");
    let on = lines[0]["effects"].as_object().expect("names and values");
    assert_eq!(on.len(), EFFECTS.len());
    folder.done("simulate -o none.log --rate 400 --fault short_a=0.2");
    assert!(folder.read("all.log") != folder.read("none.log"));
}

#[test]
fn a_wrong_file_of_effects_is_refused_with_its_line() {
    let folder = Folder::new();
    for (text, expected) in [
        (
            "emf_5 = 0.01\ncoging_nm = 1\n",
            "unit.toml:2: coging_nm: unknown effect: expected a name such as cogging_nm, ",
        ),
        (
            "emf_5 = 2\n",
            "unit.toml:1: emf_5 = 2: expected a number from -0.3 to 0.3",
        ),
        (
            "drive = \"stepper\"\n",
            "unit.toml:1: drive: expected \"hysteresis\" or \"vector\"",
        ),
        ("emf_5\n", "unit.toml:1: not valid TOML: "),
        (
            "decoupling = 0.5\n",
            "decoupling: expected the vector drive, found the hysteresis drive",
        ),
    ] {
        folder.write("unit.toml", text);
        let sentence = folder.refused("simulate -o no.log --effects unit.toml", 2);
        assert!(sentence.starts_with(&format!("hmd: {expected}")), "{sentence}");
        assert!(!folder.path("no.log").exists(), "{text}");
    }
    let sentence = folder.refused("simulate -o no.log --effects none.toml", 1);
    assert!(
        sentence.starts_with("hmd: none.toml: expected a readable file, found: "),
        "{sentence}"
    );
    folder.write("unit.log", "emf_5 = 0.01\n");
    let sentence = folder.refused("simulate -o unit.log --effects unit.log", 2);
    assert!(
        sentence.contains("expected another output than a file that is read"),
        "{sentence}"
    );
}

#[test]
fn the_list_has_every_effect_with_its_unit_range_equation_and_source() {
    let folder = Folder::new();
    let list = folder.done("simulate --list-effects");
    assert_eq!(list.lines().count(), EFFECTS.len() + 1);
    for (info, line) in EFFECTS.iter().zip(list.lines().skip(1)) {
        let mut words = line.split_whitespace();
        assert_eq!((words.next(), words.next()), (Some(info.name), Some(info.unit)));
        assert!(line.contains(info.equation) && line.ends_with(info.source), "{line}");
    }
    let of_servo28 = folder.done("simulate --list-effects --actuator servo28");
    let row = |list: &str| {
        list.lines()
            .find(|line| line.starts_with("cogging_nm"))
            .map(str::to_owned)
    };
    assert_ne!(row(&list), row(&of_servo28));
}

#[test]
fn in_speed_mode_each_profile_commands_the_motor_speed() {
    let folder = Folder::new();
    for profile in ["step", "ramp", "chirp", "mixed"] {
        folder.done(&format!(
            "simulate -o speed.log --rate 400 --windows 2 --mode speed --profile {profile}"
        ));
        let log = String::from_utf8(folder.read("speed.log")).expect("text");
        // Byte 4 of a command frame is the mode.
        let mut commands = log.lines().filter_map(|line| line.split_once(" 102#"));
        assert!(commands.all(|(_, bytes)| &bytes[8..10] == "02"), "{profile}");
        // Each actuation is one window, as in the truth.
        let records = folder.done("replay --json speed.log");
        assert_eq!(records.lines().count(), truth(&folder, "speed.log").len(), "{profile}");
        for line in records.lines() {
            let record: Value = serde_json::from_str(line).expect("JSON");
            assert!(
                record["k"].is_array() && record["faults"] == json!([]),
                "{profile}: {record}"
            );
        }
    }
}

//! A configured gear ratio that is one per cent off is named; a wide play and an elastic gear are no other ratio.

use crate::folder::Folder;

const OF_90: &str = "[type.own]\nbased_on = \"bench\"\n[type.own.transmission]\ngear_ratio = 90\n";

#[test]
#[ignore = "long form: cargo xtask robust"]
fn a_ratio_of_91_for_90_is_named_by_replay_and_by_calibrate() {
    let folder = Folder::new();
    folder.write("real.toml", OF_90);
    let actuator = "[[actuator]]\nid = 0\ntype = \"own\"\n";
    folder.write("wrong.toml", OF_90.replace("90", "91") + actuator);
    for (profile, windows) in [("mixed", 5), ("ramp", 2), ("step", 2)] {
        folder.done(&format!(
            "simulate -c real.toml --actuator own --profile {profile} --windows {windows} --noise 0.05 --seed 5 -o unit.log"
        ));
        let lines = folder.done("replay unit.log -c wrong.toml --json");
        let said = "gear ratio: it seems to be 90.";
        assert_eq!(lines.matches(said).count(), windows, "{profile}: {lines}");
        assert_eq!(lines.matches("\"faults\":[]").count(), windows, "{profile}: {lines}");
        if windows < 5 {
            continue;
        }
        // Refused or warned, with the same words.
        let ended = folder.hmd("calibrate unit.log -c wrong.toml -o unit.toml");
        assert!(ended.stderr.contains("check gear ratio"), "{}", ended.stderr);
        assert!(ended.stderr.contains(said), "{}", ended.stderr);
    }
}

#[test]
#[ignore = "long form: cargo xtask robust"]
fn a_wide_play_and_a_gear_that_bends_are_no_other_ratio() {
    let folder = Folder::new();
    let soft = "--with compliance_hz=40 --with spring_nm_per_rad=500 --with load_inertia_share=0.1";
    for unit in ["--fault backlash=0.3", "--fault backlash=1", soft] {
        for profile in ["mixed", "chirp", "ramp", "step"] {
            folder.done(&format!("simulate --profile {profile} --noise 0.05 {unit} -o unit.log"));
            let lines = folder.done("replay unit.log --json");
            assert!(!lines.contains("gear ratio"), "{unit} {profile}: {lines}");
        }
    }
}

/// A log with output angle and set point in another scale.
fn scaled(log: &str, scale: f64) -> String {
    let scaled = |line: &str| {
        let (before, data) = line.split_once('#')?;
        let is_angle = before.ends_with(" 101") || before.ends_with(" 102");
        let angle = is_angle.then(|| u32::from_str_radix(data.get(..8)?, 16).ok())??;
        let other = (scale * f64::from(angle.swap_bytes() as i32)).round() as i32;
        Some(format!("{before}#{:08X}{}\n", (other as u32).swap_bytes(), &data[8..]))
    };
    log.lines()
        .map(|line| scaled(line).unwrap_or_else(|| format!("{line}\n")))
        .collect()
}

#[test]
fn a_scale_of_output_angle_and_set_point_is_no_controller_gain() {
    let folder = Folder::new();
    let drive = "simulate --drive vector --noise 0.03 --windows";
    folder.done(&format!("{drive} 6 --seed 3 -o healthy.log"));
    folder.done("calibrate healthy.log -o unit.toml");
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    folder.done(&format!("{drive} 2 --seed 9 -o later.log"));
    let later = String::from_utf8(folder.read("later.log")).expect("a log of text");
    for scale in [0.7, 0.85, 0.9, 1.1, 1.2, 1.3] {
        folder.write("scaled.log", scaled(&later, scale));
        let lines = folder.done("replay scaled.log -c hmd.toml --json");
        assert_eq!(lines.matches("\"faults\":[]").count(), 2, "{scale}: {lines}");
        assert!(!lines.contains("\"suspects\":[]"), "{scale}: {lines}");
    }
}

/// Where the output lies in its play when the record begins is not known.
#[test]
fn a_start_in_motion_is_no_other_ratio() {
    let folder = Folder::new();
    folder.done("simulate --rate 400 --noise 0.03 --windows 3 --fault backlash=0.25 --seed 32 -o whole.log");
    let whole = String::from_utf8(folder.read("whole.log")).expect("text");
    for lines in [640, 660, 680, 700, 720] {
        folder.write_lines("cut.log", whole.lines().skip(lines - 1));
        let lines = folder.done("replay cut.log --json");
        assert!(
            !lines.contains("gear ratio") && !lines.contains("encoder counts"),
            "{lines}"
        );
    }
}

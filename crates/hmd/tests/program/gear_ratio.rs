//! A configured gear ratio that is one per cent off is named; a wide play and an elastic gear are no other ratio.

use crate::folder::Folder;

const OF_90: &str = "[type.own]\nbased_on = \"bench\"\n[type.own.transmission]\ngear_ratio = 90\n";

#[test]
fn a_ratio_of_91_for_90_is_named_by_replay_and_by_calibrate() {
    let folder = Folder::new();
    folder.write("real.toml", OF_90);
    let actuator = "[[actuator]]\nid = 0\ntype = \"own\"\n";
    folder.write("wrong.toml", OF_90.replace("90", "91") + actuator);
    for profile in ["mixed", "ramp", "step"] {
        folder.done(&format!(
            "simulate -c real.toml --actuator own --profile {profile} --windows 5 --noise 0.05 --seed 5 -o unit.log"
        ));
        let lines = folder.done("replay unit.log -c wrong.toml --json");
        let said = "gear ratio: it seems to be 90.";
        assert_eq!(lines.matches(said).count(), 5, "{profile}: {lines}");
        assert_eq!(lines.matches("\"faults\":[]").count(), 5, "{profile}: {lines}");
        // Refused or warned, with the same words.
        let ended = folder.hmd("calibrate unit.log -c wrong.toml -o unit.toml");
        assert!(ended.stderr.contains("check gear ratio"), "{}", ended.stderr);
        assert!(ended.stderr.contains(said), "{}", ended.stderr);
    }
}

#[test]
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

//! A motor angle that is logged a few samples late is named, and no healthy part is accused; a worn one still is.

use crate::folder::Folder;

/// A log whose motor angles are those of so many samples before.
fn late(log: &str, samples: usize) -> String {
    let mut before: Vec<&str> = Vec::new();
    let lines = log.lines().map(|line| match line.split_once(" 101#") {
        Some((head, data)) => {
            before.push(&data[..8]);
            let angle = before[before.len().saturating_sub(1 + samples)];
            format!("{head} 101#{angle}{}\n", &data[8..])
        }
        None => format!("{line}\n"),
    });
    lines.collect()
}

#[test]
#[ignore = "long form: cargo xtask robust"]
fn a_late_motor_angle_accuses_no_part_and_worn_parts_are_still_named() {
    let folder = Folder::new();
    let unit = "--drive vector --noise 0.03";
    folder.done(&format!("simulate {unit} --windows 8 --seed 71 -o healthy.log"));
    folder.write(
        "hmd.toml",
        "[[actuator]]\nid = 0\n[type.bench.drive]\nkind = \"vector\"\n",
    );
    folder.done("calibrate healthy.log -c hmd.toml -o unit.toml");
    folder.write(
        "hmd.toml",
        "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n[type.bench.drive]\nkind = \"vector\"\n",
    );
    for (fault, accused) in [
        ("", "\"faults\":[]"),
        ("--fault backlash=0.3", "\"faults\":[\"backlash\"]"),
        ("--fault gain=0.7", "\"faults\":[\"gain\"]"),
    ] {
        folder.done(&format!("simulate {unit} --windows 4 --seed 73 {fault} -o right.log"));
        let right = String::from_utf8(folder.read("right.log")).expect("a log of text");
        for samples in [0, 1, 2, 3, 4, 6] {
            folder.write("late.log", late(&right, samples));
            let lines = folder.done("replay late.log -c hmd.toml --json");
            for line in lines.lines() {
                let said = line.split("sample order: the motor angle seems to be ").nth(1);
                let late_ms = said.and_then(|said| said.split(' ').next()?.parse::<f64>().ok());
                let off_ms = late_ms.unwrap_or(0.0) - 0.5 * samples as f64;
                assert!(off_ms.abs() < 0.1, "{fault} {samples}: {line}");
            }
            let last = lines.lines().last().unwrap_or_default();
            assert!(last.contains(accused), "{fault} {samples}: {last}");
        }
    }
}

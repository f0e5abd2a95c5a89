//! A set point that is logged before or after currents and angles is named, and passes for no controller gain.

use crate::folder::Folder;

/// A log whose samples have the set point of `by` samples later: it is logged so early.
fn early(log: &str, by: isize) -> String {
    let is_command = |line: &&str| line.contains(" 102#");
    let set_points: Vec<&str> = log
        .lines()
        .filter(is_command)
        .filter_map(|line| line.split_once('#')?.1.get(..8))
        .collect();
    let mut sample = 0;
    let lines = log.lines().map(|line| match line.split_once(" 102#") {
        Some((before, data)) => {
            let from = usize::saturating_add_signed(sample, by).min(set_points.len() - 1);
            sample += 1;
            format!("{before} 102#{}{}\n", set_points[from], &data[8..])
        }
        None => format!("{line}\n"),
    });
    lines.collect()
}

#[test]
fn a_shifted_set_point_is_named_beside_the_true_gain_of_the_controller() {
    let folder = Folder::new();
    let drive = "--drive vector --noise 0.03 --windows";
    folder.done(&format!("simulate {drive} 6 --seed 3 -o healthy.log"));
    folder.done("calibrate healthy.log -o unit.toml");
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    for (fault, found) in [("", "[]"), ("--fault gain=0.65", "[\"gain\"]")] {
        folder.done(&format!("simulate {drive} 2 --seed 9 {fault} -o later.log"));
        let later = String::from_utf8(folder.read("later.log")).expect("a log of text");
        for (samples, said) in [(10, "ms before"), (4, "ms before"), (-4, "ms after")] {
            folder.write("shifted.log", early(&later, samples));
            let lines = folder.done("replay shifted.log -c hmd.toml --json");
            let first = lines.lines().next().unwrap_or_default();
            assert!(
                first.contains("set point delay: it seems to be logged") && first.contains(said),
                "{lines}"
            );
            assert_eq!(lines.matches(&format!("\"faults\":{found}")).count(), 2, "{lines}");
        }
        let lines = folder.done("replay later.log -c hmd.toml --json");
        assert_eq!(lines.matches("\"status\":\"ok\"").count(), 2, "{lines}");
        assert_eq!(lines.matches(&format!("\"faults\":{found}")).count(), 2, "{lines}");
    }
    // Without commissioning the monitor, which needs the set point to the sample, accuses nothing.
    folder.done("simulate --noise 0.03 --seed 9 -o later.log");
    let later = String::from_utf8(folder.read("later.log")).expect("a log of text");
    folder.write("shifted.log", early(&later, 10));
    let lines = folder.done("replay shifted.log --json");
    assert!(
        lines.contains("\"status\":\"invalid\"") && lines.contains("set point delay"),
        "{lines}"
    );
}

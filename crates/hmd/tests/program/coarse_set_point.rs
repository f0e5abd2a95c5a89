//! A set point that is logged seldom: neither its time nor the gain of the position loop is accused.

use crate::folder::Folder;

/// A log whose set point stands for so many samples at a time.
fn held(log: &str, samples: usize) -> String {
    let (mut number, mut last) = (0, "");
    let lines = log.lines().map(|line| match line.split_once(" 102#") {
        Some((head, data)) => {
            if number % samples == 0 {
                last = &data[..8];
            }
            number += 1;
            format!("{head} 102#{last}{}\n", &data[8..])
        }
        None => format!("{line}\n"),
    });
    lines.collect()
}

#[test]
#[ignore = "long form: cargo xtask robust"]
fn set_points_of_100_hz_accuse_neither_their_time_nor_the_controller() {
    let folder = Folder::new();
    let unit = "--drive vector --noise 0.03";
    let simulate = |arguments: &str| {
        folder.done(&format!("simulate {unit} {arguments} -o fine.log"));
        let fine = String::from_utf8(folder.read("fine.log")).expect("a log of text");
        folder.write("coarse.log", held(&fine, 20));
    };
    simulate("--windows 10 --seed 71");
    folder.write(
        "hmd.toml",
        "[[actuator]]\nid = 0\n[type.bench.drive]\nkind = \"vector\"\n",
    );
    folder.done("calibrate coarse.log -c hmd.toml -o unit.toml");
    folder.write(
        "hmd.toml",
        "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n[type.bench.drive]\nkind = \"vector\"\n",
    );
    for (arguments, accused) in [
        ("--windows 4 --seed 75 --load 40", "\"faults\":[]"),
        (
            "--windows 4 --seed 72 --fault friction=0.3",
            "\"faults\":[\"friction\"]",
        ),
    ] {
        simulate(arguments);
        let lines = folder.done("replay coarse.log -c hmd.toml --json");
        assert!(!lines.contains("set point delay"), "{lines}");
        assert!(lines.contains("the set point stands for 10 ms at a time"), "{lines}");
        let last = lines.lines().last().unwrap_or_default();
        assert!(last.contains(accused), "{last}");
    }
}

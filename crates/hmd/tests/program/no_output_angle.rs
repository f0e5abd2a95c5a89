//! A log without an output angle, of a trigger: the set point has a zero of its own, and times begin before zero.

use crate::folder::Folder;

/// Time before zero of the first row, s.
const BEFORE_S: f64 = 2.0;

/// The log of a simulated actuator as a table without output angle; `off` is added to its set point, rad.
fn table(log: &str, off: f64) -> String {
    let mut table = "t [s],seq,ia [A],ib [A],ic [A],motor [counts],set [rad],mode\n".to_owned();
    let (mut first, mut row) = (None, String::new());
    for line in log.lines() {
        let mut words = line.split_whitespace();
        let (Some(stamp), Some(frame)) = (words.next(), words.nth(1)) else {
            continue;
        };
        let Some((id, data)) = frame.split_once('#').filter(|(_, data)| data.len() == 16) else {
            continue;
        };
        let byte = |n: usize| u8::from_str_radix(&data[2 * n..2 * n + 2], 16).unwrap_or_default();
        let word = |n: usize| i16::from_le_bytes([byte(n), byte(n + 1)]);
        let long = |n: usize| i32::from_le_bytes([byte(n), byte(n + 1), byte(n + 2), byte(n + 3)]);
        let amperes = |n: usize| f64::from(word(n)) / 1000.0;
        match id {
            "100" => {
                let stamp: f64 = stamp.trim_matches(['(', ')']).parse().expect("a stamp");
                let time = stamp - *first.get_or_insert(stamp + BEFORE_S);
                let [a, b, c] = [0, 2, 4].map(amperes);
                row = format!("{time:.6},{},{a},{b},{c}", word(6) as u16);
            }
            "101" => row += &format!(",{}", long(0)),
            "102" => table += &format!("{row},{:.6},{}\n", 1e-6 * f64::from(long(0)) + off, byte(4)),
            _ => {}
        }
    }
    table
}

const MAP: &str = "[map]\ntime = \"t\"\nsample.counter = \"seq\"\ncurrents.a = \"ia\"\ncurrents.b = \"ib\"\ncurrents.c = \"ic\"\n\
                   position.motor = \"motor\"\ncommand.position = \"set\"\ncommand.mode = \"mode\"\n";

#[test]
fn the_zero_of_the_set_point_is_free() {
    let folder = Folder::new();
    let unit = "simulate --drive vector --noise 0.03";
    folder.done(&format!("{unit} --windows 6 --seed 3 -o healthy.log"));
    folder.done("calibrate healthy.log -o unit.toml");
    let actuator = "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n";
    folder.write("hmd.toml", format!("{actuator}{MAP}"));
    for (fault, found) in [("", "[]"), ("--fault friction=0.4", "[\"friction\"]")] {
        folder.done(&format!("{unit} --windows 2 --seed 9 {fault} -o later.log"));
        let later = String::from_utf8(folder.read("later.log")).expect("a log of text");
        for off in [0.0, 0.035, -0.5] {
            folder.write("later.csv", table(&later, off));
            let lines = folder.done("replay later.csv -c hmd.toml --json");
            assert_eq!(
                lines.matches(&format!("\"faults\":{found}")).count(),
                2,
                "{off}: {lines}"
            );
            for accused in ["encoder", "set point delay"] {
                assert!(!lines.contains(accused), "{off}: {lines}");
            }
        }
    }
}

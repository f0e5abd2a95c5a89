//! Two phase currents that are exchanged in the log: named, and taken out; which of both phases has a short is open then.

use crate::folder::Folder;

/// A frame of the built-in dictionary with the currents of phases B and C exchanged.
fn swapped(line: &str) -> String {
    match line.split_once("100#") {
        Some((head, data)) => format!("{head}100#{}{}{}{}", &data[..4], &data[8..12], &data[4..8], &data[12..]),
        None => line.to_owned(),
    }
}

#[test]
fn a_short_beside_two_swapped_phases_is_one_of_both() {
    let folder = Folder::new();
    for (fault, is_open) in [("short_a", false), ("short_b", true), ("short_c", true)] {
        folder.done(&format!(
            "simulate --noise 0.05 --seed 3 --windows 1 --fault {fault}=0.5 -o right.log"
        ));
        let right = String::from_utf8(folder.read("right.log")).expect("text");
        folder.write_lines("swapped.log", right.lines().map(swapped));
        for line in folder.replayed("swapped.log") {
            assert_eq!(line["faults"], serde_json::json!([fault]), "{line}");
            assert_eq!(line["suspects"], serde_json::json!(["phase order"]), "{line}");
            let reason = line["reason"].as_str().expect("a reason");
            assert_eq!(reason.contains("the phase of the short depends on"), is_open, "{line}");
        }
    }
}

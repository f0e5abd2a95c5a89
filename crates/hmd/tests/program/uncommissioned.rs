//! Units of which nothing is known but their type.

use crate::folder::Folder;

/// With a large load, or one that varies and is not measured, the tolerances of a type explain a worn friction as well as a healthy one.
#[test]
fn a_worn_part_that_a_load_hides_is_not_called_nominal() {
    let folder = Folder::new();
    for (actuation, seeds) in [
        ("--load 200 --fault friction=0.7", 7..9),
        ("--profile ramp --with unmeasured_load_nm=30 --fault friction=0.6", 1..3),
    ] {
        for seed in seeds {
            folder.done(&format!(
                "simulate {actuation} --noise 0.03 --windows 3 --seed {seed} -o worn.log"
            ));
            let lines = folder.done("replay worn.log --json");
            assert_eq!(lines.lines().count(), 3);
            for line in lines.lines() {
                let record: serde_json::Value = serde_json::from_str(line).expect("a line of JSON");
                assert_ne!(record["health"], "nominal", "{line}");
                let reason = record["reason"].as_str().unwrap_or_default();
                let says_why = ["too uncertain: friction", "not excited: friction"]
                    .iter()
                    .any(|why| reason.contains(why));
                assert!(
                    says_why || record["faults"] == serde_json::json!(["friction"]),
                    "{line}"
                );
            }
        }
    }
}

//! Units of which nothing is known but their type.

use serde_json::Value;

use crate::folder::Folder;

/// Records of a log of simulated actuations, one a window.
fn replayed(folder: &Folder, actuation: &str) -> Vec<Value> {
    folder.done(&format!("simulate {actuation} --noise 0.03 -o log.mcap"));
    folder.replayed("log.mcap")
}

/// The gear's loss of a load that the output carries against a spring is that of both together, not of each.
#[test]
fn a_load_and_a_spring_that_nobody_measures_are_no_friction() {
    let folder = Folder::new();
    let actuation = |worn: &str, seed| format!("--load 30 --with spring_nm_per_rad=300 {worn} --seed {seed}");
    // Against the load, and with it.
    for seed in [9, 16, 1] {
        let records = replayed(&folder, &actuation("", seed));
        assert_eq!(records.len(), 1);
        assert_eq!(records[0]["faults"], serde_json::json!([]), "{}", records[0]);
        let (k1, sigma) = (records[0]["k"][0].as_f64(), records[0]["sigma"][0].as_f64());
        let (k1, sigma) = (k1.expect("k1"), sigma.expect("its sigma"));
        assert!(k1 < 3.0 * sigma && sigma < 0.25, "{}", records[0]);

        let records = replayed(&folder, &actuation("--fault friction=0.7", seed));
        let (k1, sigma) = (records[0]["k"][0].as_f64(), records[0]["sigma"][0].as_f64());
        let (k1, sigma) = (k1.expect("k1"), sigma.expect("its sigma"));
        assert!((k1 - 0.7).abs() < 3.0 * sigma && sigma < 0.25, "{}", records[0]);
    }
}

/// With a large load, or one that varies and is not measured, the tolerances of a type explain a worn friction as well as a healthy one.
#[test]
fn a_worn_part_that_a_load_hides_is_not_called_nominal() {
    let folder = Folder::new();
    for (actuation, seeds) in [
        ("--load 200 --fault friction=0.7", 7..9),
        ("--profile ramp --with unmeasured_load_nm=30 --fault friction=0.6", 1..3),
    ] {
        for seed in seeds {
            let records = replayed(&folder, &format!("{actuation} --windows 3 --seed {seed}"));
            assert_eq!(records.len(), 3);
            for record in records {
                assert_ne!(record["health"], "nominal", "{record}");
                let reason = record["reason"].as_str().unwrap_or_default();
                let says_why = ["too uncertain: friction", "not excited: friction"]
                    .iter()
                    .any(|why| reason.contains(why));
                assert!(
                    says_why || record["faults"] == serde_json::json!(["friction"]),
                    "{record}"
                );
            }
        }
    }
}

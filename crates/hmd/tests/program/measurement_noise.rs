//! Units whose signals have another noise than when they were commissioned.

use serde_json::Value;

use crate::folder::Folder;

/// A unit of `servo270` that eight healthy windows with this noise, A rms, commissioned.
fn commissioned(noise_a: &str) -> Folder {
    let folder = Folder::new();
    let config = |calibration: &str| format!("[[actuator]]\nid = 0\ntype = \"servo270\"\n{calibration}");
    folder.write("new.toml", config(""));
    folder.write("known.toml", config("calibration = \"unit.toml\"\n"));
    folder.done(&format!(
        "simulate --actuator servo270 --noise {noise_a} --windows 8 --seed 30 -o healthy.log"
    ));
    folder.done("calibrate healthy.log -c new.toml -o unit.toml");
    folder
}

/// Records of two later windows of it.
fn later(folder: &Folder, options: &str) -> Vec<Value> {
    folder.done(&format!(
        "simulate --actuator servo270 {options} --windows 2 --seed 31 -o later.log"
    ));
    let found = folder.replayed("later.log -c known.toml");
    assert_eq!(found.len(), 2, "{options}: {found:?}");
    found
}

/// Largest standard deviation of a shorted phase.
fn sigma(found: &[Value]) -> f64 {
    let of = |record: &Value| record["sigma"][2].as_f64().unwrap_or(f64::INFINITY);
    found.iter().map(of).fold(0.0, f64::max)
}

#[test]
fn noisier_currents_widen_the_sigmas_and_hide_no_fault() {
    let folder = commissioned("0.02");
    let mut before = 0.0;
    for noise in ["0.02", "0.08", "0.12"] {
        let healthy = later(&folder, &format!("--noise {noise}"));
        for record in &healthy {
            assert!(
                matches!(record["status"].as_str(), Some("ok" | "degraded")),
                "{noise}: {record}"
            );
            assert_eq!(record["faults"], serde_json::json!([]), "{noise}: {record}");
        }
        assert!(
            sigma(&healthy) > before && sigma(&healthy) < 0.05,
            "{noise}: {healthy:?}"
        );
        before = sigma(&healthy);
        for (fault, name) in [("friction=0.3", "friction"), ("short_a=0.3", "short_a")] {
            for record in later(&folder, &format!("--noise {noise} --fault {fault}")) {
                assert_eq!(record["faults"], serde_json::json!([name]), "{noise}: {record}");
            }
        }
    }
    // A torque that goes with the angle is no noise of the currents.
    for record in later(&folder, "--noise 0.08 --with cogging_nm=0.1 --with cogging_periods=10") {
        assert_eq!(record["status"], "unmodelled", "{record}");
    }
    // Noise that no sensor has.
    for record in later(&folder, "--noise 0.4") {
        assert_eq!(record["status"], "invalid", "{record}");
    }
}

#[test]
fn quieter_currents_narrow_the_sigmas_and_hide_no_error_of_the_model() {
    let folder = commissioned("0.08");
    let [noisy, quiet] = ["0.08", "0.01"].map(|noise| sigma(&later(&folder, &format!("--noise {noise}"))));
    assert!(quiet < 0.75 * noisy, "{quiet}, {noisy}");
    for record in later(&folder, "--noise 0.01 --with cogging_nm=0.03 --with cogging_periods=10") {
        assert_eq!(record["status"], "unmodelled", "{record}");
    }
}

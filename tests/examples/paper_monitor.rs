//! What the calibration of the paper's monitor trades: `cargo run --release -p hmd-tests --example paper_monitor`.
//!
//! Prints the table of `docs/monitor.md`: mean squared error of i_q at the true fault vectors (\[P\] eq. 12, as a mean), 8 healthy and
//! 40 faulty windows of `bench` that a type's calibration learns from, for factors on back-EMF and torque gain.

use ema_identify::calibration::MonitorForm;
use ema_models::{ActuatorParams, Calibration, Form, PaperShape, Ripple};
use hmd_lab::calibrate_type::{calibrate_type, current_errors};

/// The paper's error before its calibration, A² (eq. 13).
const INITIAL_A2: f64 = 0.1292;

fn main() {
    let params = ActuatorParams::bench();
    let errors = current_errors(&params, 1);
    let at = |back_emf: f64, torque: f64| Calibration {
        back_emf,
        torque,
        ripple: Ripple::NONE,
        ..Calibration::uncorrected(Form::Paper(PaperShape::default()))
    };
    println!("| | back-EMF | torque gain | healthy, A² | faulty, A² |\n|---|---|---|---|---|");
    let row = |name: &str, found: &Calibration| {
        let [healthy, faulty] = errors(found);
        let (back_emf, torque) = (found.back_emf, found.torque);
        println!("| {name} | {back_emf:.3} | {torque:.3} | {healthy:.4} | {faulty:.4} |");
    };
    row("derived coefficients, as shipped before calibration", &at(1.0, 1.0));
    for (name, both) in [
        (
            "coupling too weak, so that the healthy error is the paper's 0.1292 A²",
            true,
        ),
        ("torque gain alone too weak, the same error", false),
    ] {
        // The error falls from 0.6 to 1.
        let (mut low, mut high) = (0.6, 1.0);
        for _ in 0..20 {
            let middle = 0.5 * (low + high);
            let tried = at(if both { middle } else { 1.0 }, middle);
            if errors(&tried)[0] > INITIAL_A2 {
                low = middle;
            } else {
                high = middle;
            }
        }
        row(name, &at(if both { low } else { 1.0 }, low));
    }
    // Grid of both factors.
    let grid: Vec<(Calibration, [f64; 2])> = (0..=20)
        .flat_map(|e| (0..=20).map(move |t| (0.95 + 0.01 * f64::from(e), 0.95 + 0.005 * f64::from(t))))
        .map(|(back_emf, torque)| (at(back_emf, torque), errors(&at(back_emf, torque))))
        .collect();
    let best = |cost: fn(&[f64; 2]) -> f64| {
        let found = grid.iter().min_by(|a, b| cost(&a.1).total_cmp(&cost(&b.1)));
        found.expect("a grid").0
    };
    row("least healthy error (grid)", &best(|[healthy, _]| *healthy));
    row(
        "least error of all 48 windows (grid)",
        &best(|[healthy, faulty]| 8.0 * healthy + 40.0 * faulty),
    );
    row("least faulty error (grid)", &best(|[_, faulty]| *faulty));
    let calibrated = calibrate_type("bench", &params, MonitorForm::Paper, 1, &|| ()).expect("a sound type");
    let calibrated = Calibration {
        ripple: Ripple::NONE,
        ..calibrated.coefficients()
    };
    row(
        "calibrated: coupling in health, then k_FS and k_E on the faulty windows",
        &calibrated,
    );
}

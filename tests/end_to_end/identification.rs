//! Identification of single windows of the reference model: where its searches end, and how sure they are.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use ema_identify::calibration::{MonitorForm, TypeCalibration};
use ema_identify::{Estimate, Identifier, Method, Population};
use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::{ActuatorParams, FaultVector, MotorKnowledge, Profile, Tolerances, UNKNOWN_COUNT, rss_pct};
use hmd_lab::calibrate_type::random_faults;
use hmd_lab::simulated::SimulatedWindow;

/// Monitor runs of one set of normal equations.
const RUNS_PER_LINEARISATION: u64 = UNKNOWN_COUNT as u64 + 1;

/// Estimate of a window with noise, under a load that nobody measures.
fn estimate(profile: Profile, seed: u64, method: Method) -> Estimate {
    let params = ActuatorParams::servo28();
    let identifier = Identifier {
        params,
        calibration: TypeCalibration::built_in("servo28", MonitorForm::ThreePhase).unwrap(),
        method,
        motor: MotorKnowledge::default(),
        tolerances: Tolerances::NONE,
    };
    let worn = FaultVector {
        friction: 0.3,
        ..FaultVector::NOMINAL
    };
    let mut scenario = Scenario {
        actuations: Actuations::single(profile),
        ..Scenario::new(params, worn, seed)
    };
    scenario.load_torque = 0.2;
    scenario.sensing = CurrentSensing {
        quantised: true,
        noise_rms: 0.05,
    };
    let mut window = SimulatedWindow::first_of(&scenario);
    window.conditions.load_torque = None;
    let found = identifier.identify(&window.prepared, window.conditions, seed);
    found.unwrap()
}

#[test]
fn a_dip_of_the_cost_is_no_knowledge_of_friction() {
    for seed in 0..8 {
        let found = estimate(Profile::Ramp, seed, Method::hybrid());
        assert_eq!(found.sigma[0], None, "ramp {seed}");
        assert!(!found.cut);
    }
    let found = estimate(Profile::Mixed, 0, Method::hybrid());
    assert!(found.sigma[0].is_some_and(|sigma| sigma < 0.02), "{:?}", found.sigma);
}

/// A population may end anywhere on a slope, where descents to either side would say nothing of its end.
#[test]
fn a_population_alone_goes_by_slopes() {
    let Method::Hybrid(population) = Method::hybrid() else {
        panic!("the default is a hybrid")
    };
    let found = estimate(Profile::Mixed, 0, Method::Population(population));
    // The first generation and five more that keep two, one linearisation, and the run of the residual.
    assert_eq!(found.evaluations, 32 + 5 * 30 + RUNS_PER_LINEARISATION + 1);
    assert!(found.sigma[0].is_some_and(|sigma| sigma < 0.1) && !found.cut);
}

#[test]
fn an_exhausted_budget_is_reported() {
    let Method::Hybrid(Population::Genetic(mut config)) = Method::hybrid() else {
        panic!("the default's population is genetic")
    };
    let enough = estimate(Profile::Ramp, 0, Method::hybrid()).evaluations;
    config.stop.max_evaluations = Some(enough - 10);
    let found = estimate(Profile::Ramp, 0, Method::Hybrid(Population::Genetic(config)));
    assert!(found.evaluations <= enough - 10, "{} of {enough}", found.evaluations);
    assert!(found.cut && found.sigma[0].is_none());
}

/// Its first coarse steps from health lead into the corner of the box outside the disc ζ ≤ 1, where nothing changes with ζ.
#[test]
fn a_descent_does_not_get_lost_outside_the_disc() {
    let params = ActuatorParams::servo28();
    let identifier = Identifier {
        params,
        calibration: TypeCalibration::built_in("servo28", MonitorForm::ThreePhase).expect("shipped"),
        method: Method::LeastSquares,
        motor: MotorKnowledge::default(),
        tolerances: Tolerances::NONE,
    };
    let truth = random_faults(70_164);
    let window = SimulatedWindow::new(&params, truth, Profile::Mixed, 80_164);
    let found = identifier.identify(&window.prepared, window.conditions, 1);
    let error = rss_pct(&found.expect("valid settings").fault, &truth);
    assert!(error < 5.0, "{error} %");
}

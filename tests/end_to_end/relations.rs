//! Units far from their data sheet, with a vector drive: the relations between measured signals find what is worn.

#[path = "../relations_units.rs"]
mod relations_units;

use ema_identify::relations::{
    BalanceShape, CommissionError, GearLossSigma, MeasuredWindow, Needed, RelationsEstimate, SinceCommissioning, Term,
    commission,
};
use ema_models::reference::{Actuations, Scenario};
use ema_models::{FAULT_COUNT, FaultVector, Profile, Tolerances};
use relations_units::{FAULTS, UNITS, Unit, simulated};

/// Largest error of a damaged parameter, and of one that is not: the largest seen on these windows is 0.02 (gain 0.7)
/// and 0.024 (short of the small servo, whose sigma is 0.01).
const DAMAGED: f64 = 0.03;
const HEALTHY: f64 = 0.03;

fn check(unit: &Unit) {
    let learnt = unit.learnt();
    let nominal = FaultVector::NOMINAL.to_array();
    let healthy = unit.estimates(&learnt, &unit.healthy());
    let faulty = unit.estimates(&learnt, &unit.faulty());
    let truths = FAULTS.iter().map(|&(parameter, value)| {
        let mut truth = nominal;
        truth[parameter] = value;
        truth
    });
    let cases = healthy
        .iter()
        .map(|estimate| (nominal, estimate))
        .chain(truths.zip(&faulty));
    for (truth, estimate) in cases {
        for parameter in (0..FAULT_COUNT).filter(|&parameter| parameter != FaultVector::ECCENTRICITY_PHASE_INDEX) {
            let error = (estimate.k[parameter] - truth[parameter]).abs();
            let damaged = (truth[parameter] - nominal[parameter]).abs() > 0.0;
            let limit = if damaged { DAMAGED } else { HEALTHY };
            assert!(error < limit, "{}: {truth:?} as {estimate:?}", unit.name);
            let sigma = estimate.sigma[parameter].expect("a mixed motion shows all");
            assert!(error < 4.5 * sigma, "{}: {truth:?} as {estimate:?}", unit.name);
        }
    }
    let direction = faulty[4].k[FaultVector::ECCENTRICITY_PHASE_INDEX];
    assert!((direction - 0.7).abs() < 0.02, "{}: direction {direction}", unit.name);
}

#[test]
fn each_fault_of_a_unit_with_other_parameters_is_found() {
    check(&UNITS[1]);
}

#[test]
fn each_fault_of_a_unit_with_wrong_sensors_is_found() {
    check(&UNITS[2]);
}

#[test]
fn each_fault_of_a_small_servo_is_found() {
    check(&UNITS[3]);
}

/// Turns that carry no current make no torque in a narrow gap either: without the product of both, an eccentricity of 0.15 beside a short of 0.3
/// read down to 0.117 by its direction.
#[test]
fn eccentricity_beside_a_short_is_found_in_each_direction() {
    let unit = &UNITS[0];
    let learnt = unit.learnt();
    let phases = [0.0, 0.25, 0.5, 0.75];
    let pairs = [(2, 0.3, 0.3), (3, 0.3, 0.15), (4, 0.2, 0.3), (3, 0.0, 0.15)];
    let cases: Vec<FaultVector> = pairs
        .iter()
        .flat_map(|&(short, turns, eccentricity)| {
            phases.map(|phase| {
                let mut k = FaultVector::NOMINAL.to_array();
                (k[short], k[5], k[6]) = (turns, eccentricity, phase);
                FaultVector::from_array(k)
            })
        })
        .collect();
    let scenarios: Vec<Scenario> = (301..)
        .zip(&cases)
        .map(|(seed, &fault)| unit.scenario(fault, seed))
        .collect();
    for (fault, estimate) in cases.iter().zip(unit.estimates(&learnt, &scenarios)) {
        for (parameter, truth) in fault.to_array().into_iter().enumerate().take(6) {
            let error = (estimate.k[parameter] - truth).abs();
            let sigma = estimate.sigma[parameter].expect("a mixed motion shows all");
            assert!(error < 3.0 * sigma, "{fault:?} as {estimate:?}");
            // As small as alone: 1 % of what is there, a floor of 0.002 and the noise.
            assert!(parameter != 5 || sigma < 0.01, "{fault:?} as {estimate:?}");
        }
    }
}

/// Jittering sample instants at 400 Hz: the angle's error is a tenth of a radian, and an inertia fitted to it came out a tenth of what it is.
#[test]
fn jittering_samples_leave_the_inertia_what_it_is() {
    let unit = Unit {
        name: "jitter",
        actuator: "bench",
        effects: &[("sample_jitter", 0.15)],
    };
    let mut params = unit.params();
    params.sensors.sample_rate = 400.0;
    let slow = |mut scenario: Scenario| {
        (scenario.nominal, scenario.unit) = (params, params);
        scenario
    };
    let recordings = simulated(&unit.commissioning().into_iter().map(slow).collect::<Vec<_>>());
    let windows: Vec<_> = recordings
        .iter()
        .map(|samples| MeasuredWindow::new(&params, samples, &[]))
        .collect();
    let learnt = commission(&windows, &BalanceShape::usual(&params)).unwrap();
    let share = learnt.balance.of(Term::Inertia) / params.motor.j;
    // Two of the tolerances of J.
    assert!((share - 1.0).abs() < 0.1, "{share}");
}

/// At 400 Hz, where the torque changes much between two samples.
#[test]
fn each_fault_is_found_at_400_hz() {
    let unit = &UNITS[0];
    let mut params = unit.params();
    params.sensors.sample_rate = 400.0;
    let windows_of = |scenarios: Vec<Scenario>| {
        let slow = |mut scenario: Scenario| {
            (scenario.nominal, scenario.unit) = (params, params);
            scenario
        };
        simulated(&scenarios.into_iter().map(slow).collect::<Vec<_>>())
    };
    let recordings = windows_of(unit.commissioning());
    let windows: Vec<_> = recordings
        .iter()
        .map(|samples| MeasuredWindow::new(&params, samples, &[]))
        .collect();
    let learnt = commission(&windows, &BalanceShape::usual(&params)).expect("a unit from healthy windows");
    // The steps of the set point are within the means between the samples; as they were seen at the samples, T_d came out 84 % low.
    assert!((learnt.balance.of(Term::DryFriction) - 0.15).abs() < 0.01, "{learnt:?}");
    for ((parameter, value), samples) in FAULTS.into_iter().zip(windows_of(unit.faulty())) {
        let estimate = learnt.estimate(&MeasuredWindow::new(&params, &samples, &[]));
        let limit = if parameter < 2 { 0.05 } else { 0.04 };
        assert!(
            (estimate.k[parameter] - value).abs() < limit,
            "{parameter}: {value} as {estimate:?}"
        );
    }
}

#[test]
fn offsets_gains_and_cogging_are_learnt() {
    let learnt = UNITS[2].learnt().balance;
    // Offsets of 50, −50 and 20 mA: about their mean, and with the other sign.
    let near = |term: Term, expected: f64, within: f64| {
        let found = learnt.of(term);
        assert!(
            (found - expected).abs() < within,
            "{term:?}: {found} instead of {expected}"
        );
    };
    near(Term::OffsetA, 0.02 / 3.0 - 0.05, 0.004);
    near(Term::OffsetB, 0.02 / 3.0 + 0.05, 0.004);
    near(Term::CoggingSin, 0.144 * 0.4f64.cos(), 0.005);
    near(Term::CoggingCos, 0.144 * 0.4f64.sin(), 0.005);
    // A sensor that reads 1 % too much makes its phase seem to have 1 % fewer turns, relative to the mean of all.
    near(Term::TurnsA, 1.0 - 0.010 + 0.005 / 3.0, 0.003);
    near(Term::TurnsB, 1.0 + 0.010 + 0.005 / 3.0, 0.003);
    near(Term::Inertia, 1e-3, 1e-5);
    near(Term::DryFriction, 0.15, 0.005);
}

/// The estimate of one window of another profile.
fn estimate_of(profile: Profile) -> RelationsEstimate {
    let unit = &UNITS[0];
    let scenario = Scenario {
        actuations: Actuations::single(profile),
        ..unit.scenario(FaultVector::NOMINAL, 301)
    };
    let params = unit.params();
    let samples: Vec<_> = scenario.run().collect();
    unit.learnt().estimate(&MeasuredWindow::new(&params, &samples, &[]))
}

#[test]
fn a_window_says_what_it_would_have_needed() {
    let ramp = estimate_of(Profile::Ramp);
    assert_eq!(ramp.needed[0], Some(Needed::BothDirections), "{ramp:?}");
    assert!(ramp.sigma[0].is_none() && ramp.k[0].abs() < 1e-12);

    let speed = estimate_of(Profile::Speed);
    assert_eq!(speed.needed[7], Some(Needed::PositionMode), "{speed:?}");

    let unit = &UNITS[0];
    let (params, learnt) = (unit.params(), unit.learnt());
    let samples = &simulated(&unit.healthy()[..1])[0];
    let at_rest = learnt.estimate(&MeasuredWindow::new(&params, &samples[..40], &[]));
    assert_eq!(at_rest.observable(), [false; FAULT_COUNT]);
    assert!(at_rest.needed[2] == Some(Needed::LongerMotion), "{at_rest:?}");
    for bad in [0, 1, 4, 5] {
        let nothing = learnt.estimate(&MeasuredWindow::new(&params, &samples[..bad], &[]));
        assert_eq!(nothing.observable(), [false; FAULT_COUNT]);
    }
}

/// A load that nobody measures, and gears that lose less or more under it than the type's: there and back friction is off by what its sigma
/// says, which is then no observation; one way it is not shown.
#[test]
fn friction_under_an_unmeasured_load_is_off_by_its_sigma() {
    let unit = &UNITS[0];
    let (params, learnt) = (unit.params(), unit.learnt());
    let since = SinceCommissioning {
        gear_loss_sigma: GearLossSigma::new(&params.transmission, &Tolerances::USUAL),
        ..SinceCommissioning::default()
    };
    let loaded = |profile: Profile, load: f64, [opposing, aiding]: [f64; 2]| {
        let mut scenario = Scenario {
            actuations: Actuations::single(profile),
            ..unit.scenario(FaultVector::NOMINAL, 401)
        };
        for (name, value) in [
            ("unmeasured_load_nm", load),
            ("opposing_efficiency_deviation", opposing),
            ("aiding_efficiency_deviation", aiding),
        ] {
            scenario.effects.set(name, value).expect("a value within its limits");
        }
        let samples: Vec<_> = scenario.run().collect();
        learnt.estimate(&MeasuredWindow::new(&params, &samples, &[]).with(since))
    };
    let gears = [[0.1, 0.1], [0.1, -0.1], [-0.1, 0.1], [-0.1, -0.1]];
    for load in [100.0, -100.0] {
        let found = gears.map(|gear| loaded(Profile::Mixed, load, gear));
        let squares = found
            .iter()
            .map(|found| (found.k[0] / found.sigma[0].expect("friction")).powi(2));
        let off = (squares.sum::<f64>() / gears.len() as f64).sqrt();
        assert!((0.4..1.2).contains(&off), "{off}: {found:?}");
        assert!(found.iter().all(|found| !found.observable()[0]), "{found:?}");
        for gear in gears {
            let one_way = loaded(Profile::Ramp, load, gear);
            assert_eq!((one_way.k[0], one_way.sigma[0]), (0.0, None), "{one_way:?}");
        }
    }
    let light = loaded(Profile::Mixed, 0.0, gears[0]);
    assert!(light.observable()[0] && light.k[0].abs() < 0.03, "{light:?}");
}

#[test]
fn filled_samples_and_numbers_that_are_not_change_no_estimate_silently() {
    let unit = &UNITS[0];
    let (params, learnt) = (unit.params(), unit.learnt());
    let mut samples = simulated(&unit.healthy()[..1]).remove(0);
    let whole = learnt.estimate(&MeasuredWindow::new(&params, &samples, &[]));
    samples[300].currents[0] = f64::NAN;
    let filled = learnt.estimate(&MeasuredWindow::new(&params, &samples, &[300]));
    assert!(filled.torque_rows < whole.torque_rows && filled.torque_rows + 20 > whole.torque_rows);
    for parameter in [0, 1, 2, 3, 4, 5, 7] {
        assert!((filled.k[parameter] - whole.k[parameter]).abs() < 0.01, "{filled:?}");
    }
    let spoilt = learnt.estimate(&MeasuredWindow::new(&params, &samples, &[]));
    assert!(
        spoilt.sigma[2].is_none() && spoilt.k.iter().all(|k| k.is_finite()),
        "{spoilt:?}"
    );
}

#[test]
fn too_few_healthy_windows_are_refused() {
    let unit = &UNITS[0];
    let params = unit.params();
    let recordings = simulated(&unit.commissioning()[..4]);
    let windows: Vec<_> = recordings
        .iter()
        .map(|samples| MeasuredWindow::new(&params, samples, &[]))
        .collect();
    let refused = commission(&windows, &BalanceShape::usual(&params));
    assert_eq!(refused, Err(CommissionError::TooFewWindows { found: 4 }));
}

//! Monitors in lanes give the same bits as the same monitors one by one, with every instruction set.

use ema_models::reference::Scenario;
use ema_models::{
    ActuatorParams, COST_LANES, Calibration, ComparedSample, Comparison, Conditions, Coordinates, FaultVector,
    Feedback, InstructionSet, Lanes32, Monitor, MotorDeviation, MotorKnowledge, Prior, RANK_LANES, Recording,
    SIGNAL_COUNT, Scale, SensedSample, Unknowns, Weights, prepare_window,
};

#[test]
fn every_lane_has_the_bits_of_its_scalar() {
    let params = ActuatorParams::bench();
    let faults: [FaultVector; 4] = [
        FaultVector::NOMINAL,
        FaultVector {
            friction: 0.4,
            short_a: 0.6,
            ..FaultVector::NOMINAL
        },
        FaultVector {
            backlash: 0.7,
            eccentricity: 0.5,
            eccentricity_phase: 0.1,
            ..FaultVector::NOMINAL
        },
        FaultVector {
            short_b: 0.3,
            short_c: 0.9,
            gain: 0.8,
            ..FaultVector::NOMINAL
        },
    ];
    let sensed: Vec<SensedSample> = Scenario::new(params, faults[1], 3).run().skip(40).take(300).collect();
    let mut samples = vec![ComparedSample::default(); sensed.len()];
    let initial = prepare_window(&params, &sensed, &[], 40, 0.0, &mut samples);

    let monitors = faults.map(|fault| {
        let unknowns = Unknowns {
            fault,
            load_torque: 3.0,
            integral: 0.01,
            motor: MotorDeviation::default(),
        };
        Monitor::new(&params, &Calibration::default(), params.motor.v_dc, &unknowns)
    });
    let together = Monitor::side_by_side(&monitors, |x| Lanes32(x.map(|x| x as f32)));
    let alone = monitors.map(|monitor| monitor.map(|x| x as f32));
    let mut state = together.start(&initial, &samples[0]);
    let mut states = alone.map(|monitor| monitor.start(&initial, &samples[0]));
    for pair in samples.windows(2) {
        together.run_sample_period(&mut state, &initial, &pair[0], &pair[1]);
        let lanes = together.output(&state);
        for (n, (monitor, state)) in alone.iter().zip(&mut states).enumerate() {
            monitor.run_sample_period(state, &initial, &pair[0], &pair[1]);
            let scalar = monitor.output(state);
            let bits = [scalar.i_d, scalar.i_q, scalar.theta_m, scalar.omega_m, scalar.theta_out].map(f32::to_bits);
            let lane = [lanes.i_d, lanes.i_q, lanes.theta_m, lanes.omega_m, lanes.theta_out].map(|l| l.0[n].to_bits());
            assert_eq!(lane, bits, "lane {n}");
        }
    }
    assert!(
        state_moved(&together.output(&state).omega_m),
        "the window is one in which something happens"
    );
}

fn state_moved(omega_m: &Lanes32<4>) -> bool {
    omega_m.0.iter().all(|omega| omega.abs() > 1.0)
}

#[test]
fn every_instruction_set_ranks_with_the_same_bits() {
    let params = ActuatorParams::bench();
    let fault = FaultVector {
        short_a: 0.5,
        ..FaultVector::NOMINAL
    };
    let sensed: Vec<SensedSample> = Scenario::new(params, fault, 5).run().skip(40).take(300).collect();
    let mut samples = vec![ComparedSample::default(); sensed.len()];
    let initial = prepare_window(&params, &sensed, &[], 40, 0.0, &mut samples);
    let calibration = Calibration::default();
    for feedback in [Feedback::Measured, Feedback::Simulated] {
        let comparison = Comparison {
            recording: Recording {
                samples: &samples,
                drive: &samples,
                initial,
            },
            params: &params,
            calibration: &calibration,
            conditions: Conditions {
                load_torque: Some(0.0),
                v_dc: params.motor.v_dc,
                winding_temp_deg_c: None,
            },
            weights: Weights {
                i_d: 0.5,
                i_q: 2.0,
                theta_m: 30.0,
                omega_m: 0.2,
                theta_out: 400.0,
            },
            feedback,
            prior: Prior {
                load_torque: 0.1,
                integral: 0.1,
                motor: MotorKnowledge::default(),
            },
        };
        let unknowns: [Unknowns; RANK_LANES] = std::array::from_fn(|n| {
            let share = n as f64 / RANK_LANES as f64;
            comparison.unknowns_with_fault(FaultVector {
                friction: share,
                short_b: 1.0 - share,
                eccentricity: 0.5 * share,
                eccentricity_phase: share,
                ..fault
            })
        });
        let bits = |set| comparison.rank_with(set, &unknowns).map(f64::to_bits);
        for set in InstructionSet::available() {
            assert_eq!(bits(set), bits(InstructionSet::Baseline), "{}", set.name());
        }
        // Costs in lanes have the bits of those computed one by one.
        let scale = Scale::new(&params);
        let points: [Coordinates; COST_LANES] = std::array::from_fn(|n| scale.coordinates(&unknowns[n]));
        for (cost, point) in comparison.costs(&points).iter().zip(&points) {
            assert_eq!(cost.to_bits(), comparison.cost(point).to_bits());
        }
        // Residuals of the comparison itself, given from outside, change no bit.
        let mut residuals = vec![[0.0; SIGNAL_COUNT]; samples.len()];
        comparison.residuals(&unknowns[1], |n, r| residuals[n] = r.to_array());
        let at = scale.coordinates(&unknowns[1]);
        let own = comparison.normal_equations(&at, 1e-3);
        let given = comparison.normal_equations_with(&at, 1e-3, &residuals);
        assert_eq!(given, own);
        // Single precision agrees with double precision.
        for (cost, u) in comparison.rank(&unknowns).iter().zip(&unknowns) {
            let exact = comparison.least_squares(u);
            assert!((cost / exact - 1.0).abs() < 1e-3, "{cost} {exact}");
        }
    }
}

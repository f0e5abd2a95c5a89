//! The yardstick: data that the monitor itself wrote, with the sensors' noise and nothing else, against the Cramér–Rao bound.

use ema_ga::ConfigError;
use ema_models::reference::CurrentSensing;
use ema_models::{
    FaultVector, Profile, Real, SIGNAL_COUNT, Scale, Signals, abc_from_alpha_beta, alpha_beta_from_dq, dq_from_abc,
};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::motors::NOISE_RMS_A;
use crate::calibrate::random_faults;
use crate::calibration::{Mismatch, SignalTable, TypeCalibration};
use crate::identify::{Identifier, Prepared, bound, refine_from};
use crate::seed::mix;
use crate::simulated::SimulatedWindow;

/// Components whose truth lies nearer to an end of its range than this many bounds are left out: there the range itself
/// is knowledge that the bound does not have.
const CLEAR_OF_ENDS: f64 = 4.0;

/// Refinements one after the other: the valley is narrow, and each has a budget.
const REFINEMENTS: u32 = 6;

/// A weight so small that the signal does not count.
const IGNORED: f64 = 1e9;

/// Root mean square of the errors over their Cramér–Rao bounds; components 1 to 5 and 8.
///
/// The estimator gets what is true of these data: the sensors' noise as the only residual, and no model error. It starts
/// where the ordinary identification ends, because with such weights the valley is too narrow to be found from afar.
pub(super) fn crlb_ratio(of_type: &Identifier, rate: f64, n: u64, seed: u64) -> Result<f64, ConfigError> {
    let mut params = of_type.params;
    params.sensors.sample_rate = rate;
    let sensors = &params.sensors;
    let currents = (2.0_f64 / 3.0).sqrt() * NOISE_RMS_A.hypot(sensors.current_lsb() / 12.0_f64.sqrt());
    let only_noise = Mismatch {
        sample_rate_hz: rate,
        ripple_share: 1.0,
        drift_rms: SignalTable::from(Signals::from_array([0.0; SIGNAL_COUNT])),
        residual_rms: SignalTable {
            i_d: currents,
            i_q: currents,
            theta_m: sensors.motor_lsb() / 12.0_f64.sqrt(),
            // The speed is the angle over again.
            omega_m: IGNORED,
            theta_out: sensors.output_lsb() / 12.0_f64.sqrt(),
        },
        correlation_samples: SignalTable {
            i_d: 1.0,
            i_q: 1.0,
            theta_m: 1.0,
            omega_m: 1.0,
            theta_out: 1.0,
        },
    };
    let identifier = Identifier {
        params,
        calibration: TypeCalibration {
            at_rate: vec![only_noise],
            ..of_type.calibration.clone()
        },
        ..of_type.clone()
    };
    let squares: Vec<Vec<f64>> = (0..n)
        .into_par_iter()
        .map(|n| {
            let case_seed = mix(seed, &[6, n, rate.to_bits()]);
            let truth = random_faults(mix(seed, &[3, n]));
            let (prepared, window) = written_by_the_monitor(&identifier, truth, case_seed);
            let ordinary = Identifier {
                params: identifier.params,
                ..of_type.clone()
            };
            let found = ordinary.identify(&prepared, window.conditions, case_seed)?;
            let coefficients = identifier.calibration.coefficients();
            let comparison = identifier.comparison(&prepared, &coefficients, window.conditions);
            let scale = Scale::new(&identifier.params);
            let bounds = bound(&comparison, &scale.coordinates(&comparison.with_fault(truth)));
            let mut end = scale.coordinates(&found.unknowns);
            for _ in 0..REFINEMENTS {
                end = refine_from(&comparison, end);
            }
            let (k, t) = (scale.unknowns(&end).fault.to_array(), truth.to_array());
            Ok([0, 1, 2, 3, 4, 7]
                .into_iter()
                .filter(|&p| t[p] > CLEAR_OF_ENDS * bounds[p] && t[p] < 1.0 - CLEAR_OF_ENDS * bounds[p])
                .map(|p| ((k[p] - t[p]) / bounds[p]).powi(2))
                .collect())
        })
        .collect::<Result<_, ConfigError>>()?;
    let all: Vec<f64> = squares.into_iter().flatten().collect();
    Ok((all.iter().sum::<f64>() / all.len().max(1) as f64).sqrt())
}

/// One window as the monitor would have moved, and the sensors read it. Setpoints and the output's counts, which drive the
/// position loop, are those of a simulated window; currents and angles are the monitor's.
fn written_by_the_monitor(identifier: &Identifier, truth: FaultVector, seed: u64) -> (Prepared, SimulatedWindow) {
    let window = SimulatedWindow::new(&identifier.params, truth, Profile::Mixed, seed);
    let coefficients = identifier.calibration.coefficients();
    let mut prepared = window.prepared.clone();
    let sensors = &identifier.params.sensors;
    let sensing = CurrentSensing {
        quantised: true,
        noise_rms: NOISE_RMS_A,
    };
    let read = |angle: f64, lsb: f64| ((angle / lsb).floor() + 0.5) * lsb;
    // The output follows the motor's measured angle, which only the first pass makes the monitor's own.
    for _ in 0..2 {
        let comparison = identifier.comparison(&prepared, &coefficients, window.conditions);
        let electrical = |theta_m: f64| {
            let theta_e = comparison.recording.initial.origin.theta_e;
            (theta_e + identifier.params.motor.pole_pairs * theta_m).sin_cos_poly()
        };
        let mut rng = ChaCha8Rng::seed_from_u64(mix(seed, &[7]));
        let mut written = comparison.recording.samples.to_vec();
        comparison.residuals(&comparison.with_fault(truth), |n, r| {
            let sample = &mut written[n];
            let theta_m = sample.theta_m - r.theta_m;
            let dq = [sample.i_d - r.i_d, sample.i_q - r.i_q];
            let currents = abc_from_alpha_beta(alpha_beta_from_dq(dq, electrical(theta_m)));
            sample.theta_m = read(theta_m, sensors.motor_lsb());
            sample.theta_out = read(sample.theta_out - r.theta_out, sensors.output_lsb());
            let noisy = sensing.read(sensors, currents, &mut rng);
            [sample.i_d, sample.i_q] = dq_from_abc(noisy, electrical(sample.theta_m));
        });
        prepared = prepared.with_samples(written);
    }
    (prepared, window)
}

const _: () = assert!(SIGNAL_COUNT == 5, "every signal has its noise above");

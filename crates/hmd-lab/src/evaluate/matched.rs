//! The yardstick: data that the monitor itself wrote, with the sensors' noise and nothing else, against the Cramér–Rao bound.

use ema_ga::ConfigError;
use std::ops::Range;

use ema_models::reference::CurrentSensing;
use ema_models::{
    ComparedSample, Comparison, Coordinates, FaultVector, Profile, Real, Recording, SIGNAL_COUNT, Scale, Weights,
    abc_from_alpha_beta, alpha_beta_from_dq, dq_from_abc,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::motors::NOISE_RMS_A;
use crate::calibrate_type::random_faults;
use crate::simulated::SimulatedWindow;
use ema_identify::calibration::{Mismatch, SignalTable, TypeCalibration};
use ema_identify::{Identifier, cramer_rao_bound, refined_from};
use hmd_core::seed::mix;

/// Components whose truth lies nearer to an end of its range than this many bounds are left out: there the range itself
/// is knowledge that the bound does not have.
const CLEAR_OF_ENDS: f64 = 4.0;

/// Steps from the ordinary weights to those of the noise alone: with such weights the valley is too narrow to be found from
/// afar.
const STAGES: u32 = 12;

/// A weight so small that the signal does not count.
const IGNORED: f64 = 1e9;

/// Root mean square of the errors over their Cramér–Rao bounds; components 1 to 5 and 8.
///
/// The estimator gets what is true of these data: the sensors' noise as the only residual, and no model error.
pub(super) fn crlb_ratio(of_type: &Identifier, rate: f64, windows: Range<u64>, seed: u64) -> Result<f64, ConfigError> {
    let mut params = of_type.params;
    params.sensors.sample_rate = rate;
    let sensors = &params.sensors;
    let currents = (2.0_f64 / 3.0).sqrt() * NOISE_RMS_A.hypot(sensors.current_lsb() / 12.0_f64.sqrt());
    let only_noise = Mismatch {
        sample_rate_hz: rate,
        model_sigma: Default::default(),
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
    let squares: Vec<Vec<f64>> = windows
        .into_par_iter()
        .map(|n| {
            let case_seed = mix(seed, &[6, n, rate.to_bits()]);
            let truth = random_faults(mix(seed, &[3, n]));
            let window = SimulatedWindow::new(&params, truth, Profile::Mixed, case_seed);
            let coefficients = identifier.calibration.coefficients();
            let inputs = identifier.comparison(&window.prepared, &coefficients, window.conditions);
            let written = written_by_the_monitor(&inputs, truth, case_seed);
            let exact = Comparison {
                recording: Recording {
                    samples: &written,
                    ..inputs.recording
                },
                ..inputs
            };
            let end = sharpest_fit(&identifier, &exact, of_type.calibration.weights(rate), case_seed)?;
            let scale = Scale::new(&params);
            let bounds = cramer_rao_bound(&exact, &scale.coordinates(&exact.unknowns_with_fault(truth)));
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

/// The fit of data whose noise is known: an ordinary one, then with weights that grow step by step to those of the noise.
fn sharpest_fit(
    identifier: &Identifier,
    exact: &Comparison<'_>,
    ordinary: Weights,
    seed: u64,
) -> Result<Coordinates, ConfigError> {
    let blurred = Comparison {
        weights: ordinary,
        ..*exact
    };
    let found = identifier.search(&blurred, seed)?;
    Ok((1..=STAGES).fold(found, |at, stage| {
        let weights = between(ordinary, exact.weights, f64::from(stage) / f64::from(STAGES));
        refined_from(&Comparison { weights, ..*exact }, at)
    }))
}

/// Weights between two, by the share of the second, in equal ratios.
fn between(from: Weights, to: Weights, share: f64) -> Weights {
    let (from, to) = (from.to_array(), to.to_array());
    Weights::from_array(std::array::from_fn(|n| from[n].powf(1.0 - share) * to[n].powf(share)))
}

/// One window as the monitor would have moved, driven by the setpoints and angles of a simulated one, with the sensors'
/// noise. What they drop of an angle counts as noise, too.
fn written_by_the_monitor(inputs: &Comparison<'_>, truth: FaultVector, seed: u64) -> Vec<ComparedSample> {
    let sensors = &inputs.params.sensors;
    let sensing = CurrentSensing {
        quantised: true,
        noise_rms: NOISE_RMS_A,
    };
    let electrical = |theta_m: f64| {
        let theta_e = inputs.recording.initial.origin.theta_e;
        (theta_e + inputs.params.motor.pole_pairs * theta_m).sin_cos_poly()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(mix(seed, &[7]));
    let mut written = inputs.recording.samples.to_vec();
    inputs.residuals(&inputs.unknowns_with_fault(truth), |n, r| {
        let sample = &mut written[n];
        let theta_m = sample.theta_m - r.theta_m;
        let dq = [sample.i_d - r.i_d, sample.i_q - r.i_q];
        let currents = abc_from_alpha_beta(alpha_beta_from_dq(dq, electrical(theta_m)));
        let noisy = sensing.measure(sensors, currents, &mut rng);
        let mut within = |lsb: f64| (rng.random::<f64>() - 0.5) * lsb;
        sample.theta_m = theta_m + within(sensors.motor_lsb());
        sample.theta_out += within(sensors.output_lsb()) - r.theta_out;
        [sample.i_d, sample.i_q] = dq_from_abc(noisy, electrical(theta_m));
    });
    written
}

const _: () = assert!(SIGNAL_COUNT == 5, "every signal has its noise above");

#[cfg(test)]
mod tests {
    use ema_models::{ActuatorParams, MotorKnowledge, Tolerances};

    use super::*;
    use ema_identify::Method;
    use ema_identify::calibration::MonitorForm;

    /// No load is a bend of the cost, and a descent across it ended five bounds away in the last of these windows.
    #[test]
    fn the_bend_at_zero_load_stops_no_descent() {
        let identifier = Identifier {
            params: ActuatorParams::bench(),
            calibration: TypeCalibration::built_in("bench", MonitorForm::ThreePhase).expect("shipped"),
            method: Method::hybrid(),
            motor: MotorKnowledge::default(),
            tolerances: Tolerances::NONE,
        };
        // Of the first forty windows only number 1 ends more than three bounds away: two shorts off by 0.001 and 0.002.
        let ratio = crlb_ratio(&identifier, 2000.0, 2..7, 1).expect("valid settings");
        assert!((0.3..1.3).contains(&ratio), "{ratio}");
    }
}

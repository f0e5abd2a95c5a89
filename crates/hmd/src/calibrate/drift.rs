//! How large the monitor's slow errors are: as large as makes the estimates' own spread agree with their errors.

use ema_models::{ActuatorParams, FAULT_COUNT, FaultVector, MotorKnowledge, Profile, SIGNAL_COUNT, Signals};
use rayon::prelude::*;

use super::{SEED_SPACE, random_faults};
use crate::calibration::{Mismatch, SignalTable, TypeCalibration};
use crate::evaluate::{Motor, Surroundings};
use crate::identify::{Identifier, KINDS, Method, OBSERVABLE_SIGMA};
use crate::seed::mix;
use crate::simulated::SimulatedWindow;

/// Commands from which errors are learnt: what excites little is what an honest sigma is for. The service command is drawn
/// for each window.
const PROFILES: [Profile; 6] = [
    Profile::Step,
    Profile::Ramp,
    Profile::Chirp,
    Profile::Mixed,
    Profile::Speed,
    Profile::Service(0),
];

/// Windows of each command; every third is healthy, and every second one of a motor off its type, behind noisy sensors,
/// under a load that nobody measures.
const WINDOWS: u64 = 12;

/// Steps of the fit. Each goes some way to the maximum of the likelihood and never back.
const STEPS: u32 = 200;

/// Drift that the fit starts from, as a share of the residuals; of the ripple it starts with all.
const FIRST_DRIFT: f64 = 0.1;

/// Drift below this share of the residuals is none.
const NO_DRIFT: f64 = 1e-3;

/// A coordinate that ends this near to its lower end was stopped by it and tells nothing of its error.
const AT_END: f64 = 1e-9;

/// One coordinate of one window: its squared error, the variance that is there anyway, and what each kind of error adds.
struct Pulled {
    square: f64,
    fixed: f64,
    kinds: [f64; KINDS],
}

impl Pulled {
    fn variance(&self, sizes: &[f64; KINDS]) -> f64 {
        self.fixed + (0..KINDS).map(|m| sizes[m] * self.kinds[m]).sum::<f64>()
    }

    /// Whether a sigma would be stated for it at all. What the window does not show, and an end in another valley, which is
    /// for rivals to tell, would otherwise decide the sizes.
    fn is_stated(&self, sizes: &[f64; KINDS]) -> bool {
        self.variance(sizes) <= OBSERVABLE_SIGMA.powi(2) && self.square <= OBSERVABLE_SIGMA.powi(2)
    }
}

/// Fills in the sizes of errors ([`Mismatch::sizes`]) of every table: the variances under which the errors of
/// estimates are most likely, if they are normal, over all commands, healthy and faulty, without noise and with it.
pub(super) fn measure(calibration: &mut TypeCalibration, params: &ActuatorParams, seed: u64) {
    for table in 0..calibration.at_rate.len() {
        let mismatch = calibration.at_rate[table];
        let mut params = *params;
        params.sensors.sample_rate = mismatch.sample_rate_hz;
        let identifier = Identifier {
            params,
            calibration: calibration.clone(),
            method: Method::LeastSquares,
            motor: MotorKnowledge::default(),
        };
        let pulled = pulled(&identifier, &mismatch, seed);
        let rms = Signals::from(mismatch.residual_rms).to_array();
        let first = std::array::from_fn(|kind| match kind {
            0 => 1.0,
            _ => (FIRST_DRIFT * rms[kind - 1]).powi(2),
        });
        let stated: Vec<Pulled> = pulled.into_iter().filter(|one| one.is_stated(&first)).collect();
        let sizes = most_likely(&stated, first);
        let table = &mut calibration.at_rate[table];
        table.ripple_share = sizes[0];
        // The fit comes ever closer to no drift at all, where there is none.
        let drift: [f64; SIGNAL_COUNT] = std::array::from_fn(|s| {
            let drift = sizes[1 + s].sqrt();
            if drift > NO_DRIFT * rms[s] { drift } else { 0.0 }
        });
        table.drift_rms = SignalTable::from(Signals::from_array(drift));
    }
}

fn pulled(identifier: &Identifier, mismatch: &Mismatch, seed: u64) -> Vec<Pulled> {
    let windows = PROFILES.len() as u64 * WINDOWS;
    let found: Vec<Vec<Pulled>> = (0..windows)
        .into_par_iter()
        .map(|n| {
            let case_seed = mix(SEED_SPACE ^ seed, &[1, n]);
            let profile = match PROFILES[(n / WINDOWS) as usize] {
                Profile::Service(_) => Profile::Service(case_seed),
                other => other,
            };
            let truth = if n % 3 == 0 {
                FaultVector::NOMINAL
            } else {
                random_faults(case_seed)
            };
            let (moved, spread) = if n % 2 == 0 {
                let window = SimulatedWindow::new(&identifier.params, truth, profile, case_seed);
                identifier.error(&window.prepared, window.conditions, &truth)
            } else {
                let motor = Motor::draw(&identifier.params, identifier.params.sensors.sample_rate, case_seed);
                let around = Surroundings {
                    profile,
                    ..Surroundings::USUAL
                };
                let window = motor.actuation(&around, truth, case_seed);
                motor
                    .calibrated(identifier)
                    .error(&window.prepared, window.conditions, &truth)
            };
            let (fixed, kinds) = spread.kinds(mismatch);
            let k = truth.to_array();
            (0..FAULT_COUNT)
                .filter(|&p| matches!(p, 5 | 6) || k[p] + moved[p] > AT_END)
                .map(|p| Pulled {
                    square: moved[p] * moved[p],
                    fixed: fixed[p],
                    kinds: kinds.map(|kind| kind[p]),
                })
                .filter(|pulled| pulled.fixed.is_finite() && pulled.kinds.iter().all(|kind| kind.is_finite()))
                .collect()
        })
        .collect();
    found.into_iter().flatten().collect()
}

/// Variances `x` for which `Σ ln V + d² / V` is least, with `V = fixed + Σ x_m kind_m`: each is multiplied by the root of what
/// the errors ask for over what is there already, which never makes the sum larger.
fn most_likely(pulled: &[Pulled], mut sizes: [f64; KINDS]) -> [f64; KINDS] {
    for _ in 0..STEPS {
        let (mut asked, mut there) = ([0.0; KINDS], [0.0; KINDS]);
        for one in pulled {
            let variance = one.variance(&sizes);
            if variance > 0.0 {
                for m in 0..KINDS {
                    asked[m] += one.kinds[m] * one.square / (variance * variance);
                    there[m] += one.kinds[m] / variance;
                }
            }
        }
        for m in 0..KINDS {
            if there[m] > 0.0 {
                sizes[m] *= (asked[m] / there[m]).sqrt();
            }
        }
    }
    sizes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variances_of_two_kinds_are_found_again() {
        // Errors of exactly the size that two kinds of variance 4 and 9 give, in windows that mix them differently.
        let pulled: Vec<Pulled> = (1..=20)
            .map(|n| {
                let mut kinds = [0.0; KINDS];
                kinds[0] = f64::from(n) / 20.0;
                kinds[1] = 1.0 - kinds[0];
                Pulled {
                    square: 1.0 + 4.0 * kinds[0] + 9.0 * kinds[1],
                    fixed: 1.0,
                    kinds,
                }
            })
            .collect();
        let sizes = most_likely(&pulled, [1.0; KINDS]);
        assert!(
            (sizes[0] - 4.0).abs() < 0.05 && (sizes[1] - 9.0).abs() < 0.05,
            "{sizes:?}"
        );
    }
}

//! Health of an actuator by one window.

use super::finite;
use super::schema::message;
use crate::health::HealthState;
use ema_models::{FAULT_COUNT, FaultId};

message! {
    /// Assessment of one window of one actuator. All fields are scalars, because viewers draw an array as one line.
    pub struct Health {
        /// Actuator name, as in the topic.
        actuator: String = 1 string;
        /// Number of the window, assessed or not, from 0.
        window: u64 = 2 uint64;
        /// Start of the window, UTC ns.
        t_start_ns: u64 = 3 uint64;
        /// `ok`, `degraded`, `invalid` or `unmodelled`.
        status: String = 4 string;
        /// Why the status is not `ok`; else empty.
        reason: String = 5 string;
        /// `nominal`, `watch`, `warning`, `critical` or `unknown`.
        health: String = 6 string;
        /// Detected faults, joined by commas.
        faults: String = 7 string;
        /// Detected faults, one by one.
        fault_list: Vec<String> = 8 string repeated;
        /// Sensors, wires and numbers that the window makes doubtful, one by one; the reason has the evidence.
        suspects: Vec<String> = 9 string repeated;
        /// Friction, 0…1; absent when the window is invalid or unmodelled, as all of k1…k8.
        k1: Option<f64> = 11 double optional;
        /// Backlash, 0…1.
        k2: Option<f64> = 12 double optional;
        /// Short circuit of phase A, 0…1.
        k3: Option<f64> = 13 double optional;
        /// Short circuit of phase B, 0…1.
        k4: Option<f64> = 14 double optional;
        /// Short circuit of phase C, 0…1.
        k5: Option<f64> = 15 double optional;
        /// Eccentricity amplitude, 0…1.
        k6: Option<f64> = 16 double optional;
        /// Eccentricity direction, 0…1 for -π…π; nominal 0.5.
        k7: Option<f64> = 17 double optional;
        /// Proportional gain, 0…1; nominal 0.5.
        k8: Option<f64> = 18 double optional;
        /// Standard deviation of k1; absent where the window tells nothing of it.
        k1_sigma: Option<f64> = 21 double optional;
        /// Standard deviation of k2; absent where the window tells nothing of it.
        k2_sigma: Option<f64> = 22 double optional;
        /// Standard deviation of k3; absent where the window tells nothing of it.
        k3_sigma: Option<f64> = 23 double optional;
        /// Standard deviation of k4; absent where the window tells nothing of it.
        k4_sigma: Option<f64> = 24 double optional;
        /// Standard deviation of k5; absent where the window tells nothing of it.
        k5_sigma: Option<f64> = 25 double optional;
        /// Standard deviation of k6; absent where the window tells nothing of it.
        k6_sigma: Option<f64> = 26 double optional;
        /// Standard deviation of k7; absent where the window tells nothing of it.
        k7_sigma: Option<f64> = 27 double optional;
        /// Standard deviation of k8; absent where the window tells nothing of it.
        k8_sigma: Option<f64> = 28 double optional;
        /// Whether the standard deviation of k1 is at most 0.1.
        k1_observable: bool = 31 bool;
        /// Whether the standard deviation of k2 is at most 0.1.
        k2_observable: bool = 32 bool;
        /// Whether the standard deviation of k3 is at most 0.1.
        k3_observable: bool = 33 bool;
        /// Whether the standard deviation of k4 is at most 0.1.
        k4_observable: bool = 34 bool;
        /// Whether the standard deviation of k5 is at most 0.1.
        k5_observable: bool = 35 bool;
        /// Whether the standard deviation of k6 is at most 0.1.
        k6_observable: bool = 36 bool;
        /// Whether the standard deviation of k7 is at most 0.1.
        k7_observable: bool = 37 bool;
        /// Whether the standard deviation of k8 is at most 0.1.
        k8_observable: bool = 38 bool;
        /// Damage by friction, 0…1; absent when the window does not show it, as all damages.
        damage_friction: Option<f64> = 41 double optional;
        /// Damage by backlash, 0…1.
        damage_backlash: Option<f64> = 42 double optional;
        /// Damage by a short circuit of phase A, 0…1.
        damage_short_a: Option<f64> = 43 double optional;
        /// Damage by a short circuit of phase B, 0…1.
        damage_short_b: Option<f64> = 44 double optional;
        /// Damage by a short circuit of phase C, 0…1.
        damage_short_c: Option<f64> = 45 double optional;
        /// Damage by eccentricity, 0…1.
        damage_eccentricity: Option<f64> = 46 double optional;
        /// Damage by a changed gain, 0…1.
        damage_gain: Option<f64> = 47 double optional;
        /// Cost of the estimate (the identification's own scale).
        cost: Option<f64> = 51 double optional;
        /// Root mean square of the current residual, A.
        residual_rms_a: Option<f64> = 52 double optional;
        /// Evaluations of the monitor that the identification took.
        evaluations: u64 = 53 uint64;
        /// State of friction, as `health`; `unknown` until a window has shown it. Empty in records of older versions, as all states.
        state_friction: String = 61 string;
        /// State of backlash.
        state_backlash: String = 62 string;
        /// State of a short circuit of phase A.
        state_short_a: String = 63 string;
        /// State of a short circuit of phase B.
        state_short_b: String = 64 string;
        /// State of a short circuit of phase C.
        state_short_c: String = 65 string;
        /// State of eccentricity.
        state_eccentricity: String = 66 string;
        /// State of the gain.
        state_gain: String = 67 string;
    }
}

super::impl_record!(Health, |health| format!("/{}/health", health.actuator));

/// A fault vector with its uncertainty, in the order k1…k8.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The fault vector.
    pub k: [f64; 8],
    /// Standard deviations; `None` where the window tells nothing of a parameter.
    pub sigma: [Option<f64>; 8],
    /// Whether the standard deviation of each parameter is at most 0.1.
    pub observable: [bool; 8],
}

impl Estimate {
    /// Whether the window tells anything of a parameter, by its place.
    #[must_use]
    pub fn tells_of(&self, parameter: usize) -> bool {
        self.observable[parameter] || self.sigma[parameter].is_some()
    }
}

impl Health {
    /// Fills k1…k8 and what belongs to them; an estimate with a value that is not a number is left out as a whole.
    pub fn set_estimate(&mut self, estimate: Option<&Estimate>) {
        let estimate = estimate.filter(|e| e.k.iter().all(|k| k.is_finite()));
        let k = estimate.map_or([None; 8], |e| e.k.map(Some));
        let sigma = estimate.map_or([None; 8], |e| e.sigma.map(|sigma| sigma.and_then(finite)));
        let observable = estimate.map_or([false; 8], |e| e.observable);
        [self.k1, self.k2, self.k3, self.k4, self.k5, self.k6, self.k7, self.k8] = k;
        [self.k1_sigma, self.k2_sigma, self.k3_sigma, self.k4_sigma] = [sigma[0], sigma[1], sigma[2], sigma[3]];
        [self.k5_sigma, self.k6_sigma, self.k7_sigma, self.k8_sigma] = [sigma[4], sigma[5], sigma[6], sigma[7]];
        [
            self.k1_observable,
            self.k2_observable,
            self.k3_observable,
            self.k4_observable,
        ] = [observable[0], observable[1], observable[2], observable[3]];
        [
            self.k5_observable,
            self.k6_observable,
            self.k7_observable,
            self.k8_observable,
        ] = [observable[4], observable[5], observable[6], observable[7]];
    }

    /// The estimate, or `None` when any of k1…k8 is absent.
    pub fn estimate(&self) -> Option<Estimate> {
        let k = [
            self.k1?, self.k2?, self.k3?, self.k4?, self.k5?, self.k6?, self.k7?, self.k8?,
        ];
        let sigma = self.sigmas();
        let observable = [
            self.k1_observable,
            self.k2_observable,
            self.k3_observable,
            self.k4_observable,
            self.k5_observable,
            self.k6_observable,
            self.k7_observable,
            self.k8_observable,
        ];
        Some(Estimate { k, sigma, observable })
    }

    /// Damages in the order of [`FaultId::ALL`]; `None` where unknown.
    #[must_use]
    pub fn damages(&self) -> [Option<f64>; FaultId::COUNT] {
        [
            self.damage_friction,
            self.damage_backlash,
            self.damage_short_a,
            self.damage_short_b,
            self.damage_short_c,
            self.damage_eccentricity,
            self.damage_gain,
        ]
    }

    /// Standard deviations of k1…k8.
    fn sigmas(&self) -> [Option<f64>; FAULT_COUNT] {
        [
            self.k1_sigma,
            self.k2_sigma,
            self.k3_sigma,
            self.k4_sigma,
            self.k5_sigma,
            self.k6_sigma,
            self.k7_sigma,
            self.k8_sigma,
        ]
    }

    /// Standard deviations of the damages, in the same order; `None` where unknown.
    #[must_use]
    pub fn damage_sigmas(&self) -> [Option<f64>; FaultId::COUNT] {
        let sigmas = self.sigmas();
        FaultId::ALL.map(|fault| sigmas[fault.parameter()].map(|sigma| fault.damage_per_change() * sigma))
    }

    /// Fills the damages, in the order of [`FaultId::ALL`]; a value that is not a number is left out.
    pub fn set_damage(&mut self, damage: [Option<f64>; FaultId::COUNT]) {
        let damage = damage.map(|damage| damage.and_then(finite));
        [
            self.damage_friction,
            self.damage_backlash,
            self.damage_short_a,
            self.damage_short_b,
        ] = [damage[0], damage[1], damage[2], damage[3]];
        [self.damage_short_c, self.damage_eccentricity, self.damage_gain] = [damage[4], damage[5], damage[6]];
    }

    /// State of each fault, in the order of [`FaultId::ALL`]; `None` in records of older versions.
    #[must_use]
    pub fn states(&self) -> Option<[HealthState; FaultId::COUNT]> {
        let names = [
            &self.state_friction,
            &self.state_backlash,
            &self.state_short_a,
            &self.state_short_b,
            &self.state_short_c,
            &self.state_eccentricity,
            &self.state_gain,
        ];
        let is_there = names.iter().any(|name| !name.is_empty());
        is_there.then(|| names.map(|name| HealthState::named(name)))
    }

    /// Fills the states of the faults, in the order of [`FaultId::ALL`].
    pub fn set_states(&mut self, states: &[HealthState; FaultId::COUNT]) {
        [
            self.state_friction,
            self.state_backlash,
            self.state_short_a,
            self.state_short_b,
            self.state_short_c,
            self.state_eccentricity,
            self.state_gain,
        ] = states.map(|state| state.name().to_owned());
    }

    /// Fills both forms of the list of faults.
    pub fn set_faults(&mut self, faults: &[FaultId]) {
        self.fault_list = faults.iter().map(|fault| fault.name().to_owned()).collect();
        self.faults = self.fault_list.join(",");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prost::Message;

    #[test]
    fn an_estimate_survives_the_record() {
        let estimate = Estimate {
            k: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8],
            sigma: [
                Some(0.01),
                Some(0.02),
                None,
                Some(0.04),
                Some(0.05),
                Some(0.06),
                Some(0.07),
                Some(0.08),
            ],
            observable: [true, true, false, true, true, true, false, true],
        };
        let mut health = Health::default();
        health.set_estimate(Some(&estimate));
        health.set_damage([Some(0.1), Some(f64::NAN), None, None, None, None, Some(0.6)]);
        health.set_faults(&[FaultId::Friction, FaultId::Gain]);
        let again = Health::decode(health.encode_to_vec().as_slice()).unwrap();
        assert_eq!(again, health);
        assert_eq!(again.estimate(), Some(estimate));
        assert_eq!(again.damage_backlash, None);
        assert_eq!(again.faults, "friction,gain");
    }

    #[test]
    fn a_value_that_is_not_a_number_leaves_no_estimate() {
        let mut health = Health::default();
        let mut estimate = Estimate {
            k: [0.5; 8],
            sigma: [Some(f64::INFINITY); 8],
            observable: [true; 8],
        };
        health.set_estimate(Some(&estimate));
        assert_eq!(health.estimate().map(|e| e.sigma), Some([None; 8]));
        estimate.k[3] = f64::NAN;
        health.set_estimate(Some(&estimate));
        assert_eq!(health.estimate(), None);
        assert_eq!(health.k1, None);
    }
}

//! How far friction may be off by what a gear loses under a load.
//!
//! A load M has the torque M/(n η_o) at the motor shaft while it opposes the motion, and M η_a/n while it aids it. Friction is half of
//! what the torques of both directions have in common, so that it takes half of the error of each, and in one direction all of its own.

use ema_models::{Tolerances, TransmissionParams};

/// Directions in which a motor turns in a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Directions {
    /// There and back.
    Both,
    /// One alone.
    One,
}

/// One standard deviation of the torque of a load at the motor shaft by the tolerances of the gear's efficiencies, as a share of M/n.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GearLossSigma {
    /// While the load opposes the motion: σ_o/η_o.
    opposing: f64,
    /// While it aids it: σ_a η_a.
    aiding: f64,
}

impl GearLossSigma {
    /// Of a gear, by the tolerances of its type.
    #[must_use]
    pub fn new(gear: &TransmissionParams, tolerances: &Tolerances) -> Self {
        Self {
            opposing: tolerances.efficiency_opposing / gear.efficiency_opposing,
            aiding: tolerances.efficiency_aiding * gear.efficiency_aiding,
        }
    }

    /// One standard deviation of k1 by a load of so much more than at commissioning, Nm at the output, of a unit with the dry friction T_d, Nm
    /// at the motor: `½ σ_T/T_d` with `σ_T = ½ M/n √((σ_o/η_o)² + (σ_a η_a)²)` of motion in both directions, and in one `M/n` times the
    /// larger of σ_o/η_o and σ_a η_a. Where the load is found with friction, the first is at most twice as much as what is left. Derived here.
    #[must_use]
    pub fn of_friction(&self, load: f64, directions: Directions, gear_ratio: f64, dry_friction: f64) -> f64 {
        let share = match directions {
            Directions::Both => 0.5 * libm::hypot(self.opposing, self.aiding),
            Directions::One => self.opposing.max(self.aiding),
        };
        0.5 * share * load.max(0.0) / gear_ratio / dry_friction.max(f64::MIN_POSITIVE)
    }
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use ema_models::ActuatorParams;

    use super::*;

    /// What is left of a load M of a gear whose efficiencies are other ones than is taken, by the torques of both directions and by one.
    #[test]
    fn friction_is_off_by_the_errors_of_the_efficiencies() {
        let gear = ActuatorParams::bench().transmission;
        let sigma = GearLossSigma::new(&gear, &Tolerances::USUAL);
        let (load, dry) = (100.0 / gear.gear_ratio, gear.friction_dynamic);
        let [o, a] = [
            Tolerances::USUAL.efficiency_opposing,
            Tolerances::USUAL.efficiency_aiding,
        ];
        let mut squares = [0.0; 3];
        for (o, a) in [(o, a), (o, -a), (-o, a), (-o, -a)] {
            let [opposing, aiding] = [1.0 / gear.efficiency_opposing, gear.efficiency_aiding];
            // Forward against the load, backward with it.
            let forward = dry + load * opposing * (1.0 - o);
            let backward = dry - load * aiding * (1.0 + a);
            let known = 0.5 * (forward - load * opposing + backward + load * aiding) - dry;
            let one_way = forward - load * opposing - dry;
            let found_load = (forward - backward) / (opposing + aiding);
            let found = forward - found_load * opposing - dry;
            for (sum, error) in squares.iter_mut().zip([known, one_way, found]) {
                *sum += (0.5 * error / dry).powi(2) / 4.0;
            }
        }
        let [known, one_way, found] = squares.map(f64::sqrt);
        let of = |directions| sigma.of_friction(100.0, directions, gear.gear_ratio, dry);
        assert!((known / of(Directions::Both) - 1.0).abs() < 1e-9, "{known}");
        assert!((one_way / of(Directions::One) - 1.0).abs() < 1e-9, "{one_way}");
        let left = found / of(Directions::Both);
        assert!((0.5..1.0).contains(&left), "{left}");
    }
}

//! [`RotorFrame`]: phase currents of a row as currents along and across the rotor's north pole, and back.
//!
//! Phase currents turn with the rotor, at speed many electrical turns in few samples; in its frame they are as smooth as the torque. So they
//! are interpolated there, with the angle that is interpolated beside them. An angle whose counter begins again has to have all its turns: the
//! counter may begin again anywhere in a turn.

use super::rows::electrical_rad_per_count;
use super::{Column, Quantity};
use crate::dbc::{Role, Unit};
use ema_models::{
    ActuatorParams, Real, abc_from_alpha_beta, alpha_beta_from_abc, alpha_beta_from_dq, dq_from_alpha_beta,
};

/// Places of the motor's angle and the phase currents in a row, each with its unit.
#[derive(Debug)]
pub struct RotorFrame {
    motor: (usize, Unit),
    phases: [(usize, Unit); 2],
    third: Option<(usize, Unit)>,
    rad_per_count: f64,
}

impl RotorFrame {
    /// Of columns with phase currents; `None` where they are those of the rotor's frame already.
    #[must_use]
    pub fn new(columns: &[Column], units: &[Unit], params: &ActuatorParams) -> Option<Self> {
        let of = |role: Role| {
            let place = columns
                .iter()
                .position(|column| column.quantity == Quantity::Of(role))?;
            Some((place, units[place]))
        };
        Some(Self {
            motor: of(Role::MotorPosition)?,
            phases: [of(Role::CurrentA)?, of(Role::CurrentB)?],
            third: of(Role::CurrentC),
            rad_per_count: electrical_rad_per_count(params),
        })
    }

    /// Puts i_d, i_q and the mean of the three phases, A, in the places of the phase currents; no numbers where one or the angle is missing.
    pub fn enter(&self, row: &mut [f64]) {
        let value = |&(place, unit): &(usize, Unit)| unit.to_internal(row[place]);
        let [a, b] = [value(&self.phases[0]), value(&self.phases[1])];
        let c = self.third.as_ref().map_or(-a - b, value);
        let sin_cos = self.sin_cos(row);
        let mean = (a + b + c) / 3.0;
        let [d, q] = dq_from_alpha_beta(alpha_beta_from_abc([a, b, c]), sin_cos);
        let is_whole = (d + q + mean).is_finite();
        let or_none = |current: f64| if is_whole { current } else { f64::NAN };
        row[self.phases[0].0] = or_none(d);
        row[self.phases[1].0] = or_none(q);
        if let Some((place, _)) = self.third {
            row[place] = or_none(mean);
        }
    }

    /// Puts the phase currents back, in their own numbers.
    pub fn leave(&self, row: &mut [f64]) {
        let [d, q] = self.phases.map(|(place, _)| row[place]);
        let mean = self.third.map_or(0.0, |(place, _)| row[place]);
        let abc = abc_from_alpha_beta(alpha_beta_from_dq([d, q], self.sin_cos(row)));
        let places = self.phases.iter().chain(&self.third);
        for (&(place, unit), current) in places.zip(abc) {
            row[place] = (current + mean - unit.offset) / unit.scale;
        }
    }

    /// What is in each place of a phase current.
    pub fn names(&self) -> impl Iterator<Item = (usize, &'static str)> {
        const NAMES: [&str; 3] = ["i_d", "i_q", "the mean of the phases"];
        let places = self.phases.iter().chain(&self.third);
        places.zip(NAMES).map(|((place, _), name)| (*place, name))
    }

    fn sin_cos(&self, row: &[f64]) -> (f64, f64) {
        let (place, unit) = self.motor;
        let angle = unit.to_internal(row[place]) * self.rad_per_count;
        angle.rem_euclid(core::f64::consts::TAU).sin_cos_poly()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(third: bool) -> RotorFrame {
        let roles = [Role::MotorPosition, Role::CurrentA, Role::CurrentB, Role::CurrentC];
        let columns: Vec<Column> = roles[..if third { 4 } else { 3 }]
            .iter()
            .map(|role| Column::plain(Quantity::Of(*role), "x"))
            .collect();
        let units = [(1.0, 0.0), (1e-3, 0.5), (2e-3, 0.0), (-1e-3, 0.0)].map(|(scale, offset)| Unit { scale, offset });
        RotorFrame::new(&columns, &units, &ActuatorParams::bench()).unwrap()
    }

    #[test]
    fn a_row_comes_back_and_a_steady_torque_is_steady() {
        let params = ActuatorParams::bench();
        let per_turn = params.sensors.motor_counts_per_rev / params.motor.pole_pairs;
        for third in [false, true] {
            let frame = frame(third);
            for n in 0..12 {
                let angle = core::f64::consts::TAU * f64::from(n) / 12.0;
                let counts = per_turn * f64::from(n) / 12.0;
                // i_d = 1 A, i_q = 5 A.
                let phase = |shift: f64| {
                    let at = angle - shift * core::f64::consts::TAU / 3.0;
                    at.cos() - 5.0 * at.sin()
                };
                let own = [counts, (phase(0.0) - 0.5) / 1e-3, phase(1.0) / 2e-3, phase(2.0) / -1e-3];
                let own = &own[..if third { 4 } else { 3 }];
                let mut row = own.to_vec();
                frame.enter(&mut row);
                let expected = [1.0, 5.0, 0.0];
                for (found, expected) in row[1..].iter().zip(expected) {
                    assert!((found - expected).abs() < 1e-4, "{row:?}");
                }
                frame.leave(&mut row);
                for (found, own) in row.iter().zip(own) {
                    assert!((found - own).abs() < 1e-6 * own.abs().max(1.0), "{row:?}");
                }
            }
        }
        let mut row = [0.0, 1.0, f64::NAN, 2.0];
        frame(true).enter(&mut row);
        assert!(row[1..].iter().all(|current| current.is_nan()), "{row:?}");
    }
}

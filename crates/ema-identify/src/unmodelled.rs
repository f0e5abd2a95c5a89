//! What no fault vector explains.

use ema_models::{Comparison, Coordinates, MOTOR_COORDINATES, MotorKnowledge, Recording, Setpoint};

use super::refine::{End, descend};
use super::{Estimate, rivals};

/// A cost above this says that no fault vector explains the window: weighted residuals of four times their expected
/// size. Good windows of every profile cost 1.0 to 1.5 without sensor noise, 2.0 to 2.7 with 50 mA rms on the currents and
/// 5.5 to 6.3 with 100 mA.
const UNMODELLED_COST: f64 = 15.0;

/// A back-EMF coefficient this far from what was expected, as a share, is no motor of the type: it is twice what
/// manufacturers guarantee, and what the temperature explains is part of what is expected.
const BACK_EMF_OFF: f64 = 0.15;

/// What makes an estimate worthless though the data are good.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unmodelled {
    /// The motor does not turn as it is told.
    Locked,
    /// No fault vector explains the data: the cost.
    Cost(f64),
    /// The motor is none of its type: its back-EMF coefficient beyond what was expected, as a share.
    Magnets(f64),
}

impl std::fmt::Display for Unmodelled {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Locked => write!(f, "the motor does not turn as it is told"),
            Self::Cost(cost) => write!(f, "no fault vector explains the data: cost {cost:.0}"),
            Self::Magnets(off) => write!(
                f,
                "no motor of this type: back-EMF {:+.0} % off what is expected",
                100.0 * off
            ),
        }
    }
}

/// Whether a cost alone says that the data are of something the monitor does not know.
#[must_use]
pub fn is_unmodelled(cost: f64) -> bool {
    cost.is_nan() || cost > UNMODELLED_COST
}

impl Estimate {
    /// Why the data, though good, are of something the monitor does not know; `None` where it knows.
    #[must_use]
    pub fn unmodelled(&self) -> Option<Unmodelled> {
        if self.locked {
            Some(Unmodelled::Locked)
        } else if is_unmodelled(self.cost) {
            Some(Unmodelled::Cost(self.cost))
        } else if self.back_emf_off.abs() > BACK_EMF_OFF || self.other_motor {
            Some(Unmodelled::Magnets(self.back_emf_off))
        } else {
            None
        }
    }
}

/// Share of what was commanded that the motor must have turned.
const LEAST_TURN: f64 = 0.1;

/// Time that it has for it, s: what is commanded later than this before the window's end does not count.
const TIME_TO_TURN: f64 = 0.1;

/// Whether the motor stood while it was told to move. Then there is nothing to compare: a brake, a jam and a motor without
/// any torque look the same.
pub(super) fn is_locked(comparison: &Comparison<'_>) -> bool {
    let Recording { samples, .. } = comparison.recording;
    let Some(first) = samples.first() else { return false };
    let rate = comparison.params.sensors.sample_rate;
    let counted = samples.len().saturating_sub((TIME_TO_TURN * rate) as usize);
    let gear = comparison.params.transmission.gear_ratio;
    let (mut commanded, mut asked) = (0.0, 0.0_f64);
    for sample in &samples[..counted] {
        match (sample.setpoint, first.setpoint) {
            (Setpoint::Position(now), Setpoint::Position(before)) => commanded = gear * (now - before),
            (Setpoint::Speed(speed), _) => commanded += speed / rate,
            _ => {}
        }
        asked = asked.max(f64::abs(commanded));
    }
    let turned = samples
        .iter()
        .map(|sample| (sample.theta_m - first.theta_m).abs())
        .fold(0.0, f64::max);
    turned < LEAST_TURN * asked
}

/// Shorts in all three phases from which on a weak magnet is thought of.
const ALL_SHORTED: f64 = 0.05;

/// What is left open of the back-EMF coefficient for that, as a share.
const ANY_MAGNET: f64 = 0.3;

/// What became of the thought that the magnets are weak and not all three phases shorted.
pub(super) enum WeakMagnet {
    /// Not thought of, or the window speaks against it.
    No(u64),
    /// It explains the window as well.
    Perhaps(End),
    /// It explains the window clearly better than what is known of the motor allows.
    Yes(End),
}

/// Three phases shorted alike and a weak magnet look much the same. Where an end has all three, looks whether the motor's
/// back-EMF, left open, takes their place.
pub(super) fn weak_magnet(comparison: &Comparison<'_>, end: &End, budget: u64) -> WeakMagnet {
    let common = end.at.0[2].min(end.at.0[3]).min(end.at.0[4]);
    let known = comparison.prior.motor;
    if common < ALL_SHORTED || known.information().is_none() {
        return WeakMagnet::No(0);
    }
    let mut open = *comparison;
    open.prior.motor = MotorKnowledge {
        mean: known.mean,
        covariance: [[known.covariance[0][0], 0.0], [0.0, ANY_MAGNET * ANY_MAGNET]],
    };
    let mut start = end.at.0;
    for phase in &mut start[2..=4] {
        *phase -= common;
    }
    start[MOTOR_COORDINATES[1]] -= common;
    let found = descend(&open, Coordinates(start), budget);
    let before = open.cost(&end.at);
    let allowed = rivals::undecided(&open, found.cost.min(before));
    let apart = rivals::apart(&found.at, &end.at, |_| true);
    let spent = found.spent + 1;
    if apart && found.cost < before - allowed {
        WeakMagnet::Yes(End { spent, ..found })
    } else if apart && found.cost < before + allowed {
        WeakMagnet::Perhaps(End { spent, ..found })
    } else {
        WeakMagnet::No(spent)
    }
}

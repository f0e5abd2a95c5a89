//! Which signal of a log each quantity is guessed to be, and why a guess is no more than a comment.

use ema_models::ActuatorParams;
use hmd_core::dbc::Role;
use hmd_core::log_map::{Doubt, Quantity};
use hmd_ingest::file::SurveyedSignal;

use super::line::{has_known_modes, quoted};

/// The signal that each quantity is guessed to be.
pub(super) struct Guesses<'a> {
    signals: &'a [SurveyedSignal],
    meant: Vec<(Quantity, &'a SurveyedSignal)>,
    /// Conditions that no name says, and the only signal in a unit of each.
    by_unit: Vec<(Quantity, &'a SurveyedSignal)>,
}

/// Conditions whose unit few other signals have.
const CONDITIONS: [Quantity; 3] = [
    Quantity::Of(Role::DcLink),
    Quantity::Of(Role::WindingTemp),
    Quantity::Of(Role::LoadTorque),
];

impl<'a> Guesses<'a> {
    pub(super) fn of(signals: &'a [SurveyedSignal]) -> Self {
        let least_doubt = |quantity| {
            let of = signals.iter().filter(|signal| signal.guess == Some(quantity));
            Some((quantity, of.min_by_key(|signal| signal.doubt)?))
        };
        let meant: Vec<_> = Quantity::all().filter_map(least_doubt).collect();
        let unnamed = CONDITIONS
            .into_iter()
            .filter(|quantity| meant.iter().all(|(of, _)| of != quantity));
        let by_unit = unnamed.filter_map(|quantity| Some((quantity, only_in_its_unit(signals, quantity)?)));
        let by_unit = by_unit.collect();
        Self {
            signals,
            meant,
            by_unit,
        }
    }

    pub(super) fn meant(&self, of: Quantity) -> Option<&'a SurveyedSignal> {
        let found = self.meant.iter().find(|(quantity, _)| *quantity == of);
        found.map(|(_, signal)| *signal)
    }

    /// The only signal in a unit of a condition that no name says: its name may mean another of that unit.
    pub(super) fn by_unit(&self, of: Quantity) -> Option<&'a SurveyedSignal> {
        let found = self.by_unit.iter().find(|(quantity, _)| *quantity == of);
        found.map(|(_, signal)| *signal)
    }

    /// What is meant, where it is no comment alone.
    pub(super) fn written(&self, of: Quantity) -> Option<&'a SurveyedSignal> {
        self.meant(of).filter(|signal| self.why_not(of, signal).is_none())
    }

    /// Names of others that it may be.
    pub(super) fn others(&self, of: Quantity) -> Vec<String> {
        /// The most that are named.
        const MOST: usize = 4;
        let Some(meant) = self.meant(of).filter(|meant| !meant.is_own_time) else {
            return Vec::new();
        };
        let is_other = |signal: &&SurveyedSignal| signal.guess == Some(of) && signal.name != meant.name;
        let others = self.signals.iter().filter(is_other);
        let others = others.filter(|signal| !signal.doubt.needs_scale());
        others.take(MOST).map(|signal| quoted(&signal.name)).collect()
    }

    /// Why a guess stands in a comment alone; `None`: it does not.
    pub(super) fn why_not(&self, of: Quantity, signal: &SurveyedSignal) -> Option<&'static str> {
        let has = |quantity: Quantity| self.meant(quantity).is_some();
        let has_phases = has(Quantity::Of(Role::CurrentA)) && has(Quantity::Of(Role::CurrentB));
        let is_rotor = matches!(of, Quantity::CurrentD | Quantity::CurrentQ);
        match of {
            _ if signal.is_ambiguous => Some("several columns have this name: rename the others in the file"),
            Quantity::Time if signal.range.is_none() && !signal.texts.is_empty() => {
                Some("no number, and no date that is read: see docs/logs.md")
            }
            Quantity::Of(Role::MotorPosition) if signal.doubt == Doubt::Electrical => {
                Some("the electrical angle: scale = 1 / pole pairs")
            }
            Quantity::Of(Role::CommandPosition) if signal.doubt == Doubt::OtherSide => {
                Some("set point of the motor: scale = 1 / gear ratio")
            }
            Quantity::Of(Role::CommandSpeed) if signal.doubt == Doubt::OtherSide => {
                Some("set point of the output: scale = gear ratio")
            }
            _ if of.is_current() && has(Quantity::CurrentQ) && has_phases == is_rotor => {
                Some("either phase currents or those of the rotor's frame")
            }
            Quantity::MODE if !has_known_modes(signal) => Some("its values in position and speed mode"),
            Quantity::Of(Role::CommandSpeed) if has(Quantity::Of(Role::CommandPosition)) => {
                let mode = self.meant(Quantity::MODE).filter(|mode| has_known_modes(mode));
                mode.is_none().then_some("both set points take command.mode")
            }
            Quantity::Counter if begins_again(signal) => Some("it begins again too early to count samples"),
            _ => None,
        }
    }
}

/// The signal in a unit of a quantity, where there is one alone, and it looks like no other quantity.
fn only_in_its_unit(signals: &[SurveyedSignal], quantity: Quantity) -> Option<&SurveyedSignal> {
    let dimension = quantity.dimension(&ActuatorParams::bench());
    let is_of = |signal: &&SurveyedSignal| {
        signal
            .unit_or_guess()
            .is_some_and(|unit| dimension.unit(unit).is_some())
    };
    let mut found = signals.iter().filter(is_of);
    let only = found.next().filter(|signal| signal.guess.is_none())?;
    found.next().is_none().then_some(only)
}

/// Whether a counter had fewer values than rows, and is none of 16 bits.
fn begins_again(signal: &SurveyedSignal) -> bool {
    let range = signal.range.map_or(0.0, |[least, largest]| largest - least);
    range + 1.0 < signal.values as f64 && range < f64::from(u16::MAX)
}

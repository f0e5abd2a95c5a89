//! What a column may be, by its name and unit.

mod names;

use ema_models::ActuatorParams;

use super::Quantity;
use crate::dbc::Role;
use names::{
    ANGLE, BESIDE_WINDING, COMMANDED, COMMANDED_WORDS, DERIVED, DERIVED_WORDS, ELECTRICAL_ENDS, ELECTRICAL_STARTS,
    ELECTRICAL_WORDS, MOTOR, MOTOR_WORDS, NAMES, OF_CURRENTS, OF_SECOND_CURRENTS, OUTPUT, RATHER_MOTOR, RATHER_OUTPUT,
    SECOND, SIDES, UNITS, WINDING,
};

/// What a column may be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Guess {
    /// The quantity.
    pub quantity: Quantity,
    /// Its unit by its name or an unusual text of the log, where the log has none that is known.
    pub unit: Option<String>,
    /// Of several columns of one quantity that with the least doubt is meant.
    pub doubt: Doubt,
}

/// What speaks against a guess, the least first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Doubt {
    /// Nothing.
    None,
    /// A word in its name: filtered, estimated, of an encoder that may be of the motor or of the output.
    Word,
    /// A set point of the other side of the gear: it needs the gear ratio as its scale.
    OtherSide,
    /// An electrical angle of the motor: it needs 1 / pole pairs as its scale.
    Electrical,
}

impl Doubt {
    /// Whether it is the quantity only with a scale that the log does not tell.
    #[must_use]
    pub fn needs_scale(self) -> bool {
        self >= Self::OtherSide
    }
}

impl Quantity {
    /// What a column of this name and unit may be; where it has no unit, also by the one that its name ends with, as in `iq_A` and
    /// `speed_rad_s`, and that unit.
    #[must_use]
    pub fn guess(name: &str, unit: Option<&str>) -> Option<Guess> {
        let by_ending = || {
            name.match_indices('_').find_map(|(at, _)| {
                let ending = name[at + 1..].replace('_', "/");
                let known = UNITS.iter().find(|unit| unit.eq_ignore_ascii_case(&ending));
                let unit = known.map_or(ending.as_str(), |unit| *unit);
                let guess = Self::guess_with(&name[..at], Some(unit))?;
                let is_of_unit = !matches!(guess.quantity, Self::Counter | Self::MODE);
                is_of_unit.then(|| guess.with_unit(unit))
            })
        };
        // A group before the signal says little, and neither does a side.
        let alone = name.rsplit(['.', '/', ':']).next().filter(|alone| !alone.is_empty());
        let one = name
            .split_once('_')
            .filter(|(side, _)| SIDES.contains(&side.to_lowercase().as_str()));
        let plain = |unit| {
            Self::guess_with(name, unit)
                .or_else(|| Self::guess_with(alone?, unit))
                .or_else(|| Self::guess_with(one?.1, unit))
        };
        let Some(unit) = unit else {
            return by_ending().or_else(|| plain(None));
        };
        // As `deg el`.
        let parts: Vec<&str> = unit.split([' ', '_']).collect();
        match parts.as_slice() {
            [unit, rest] if is_electrical(rest) => {
                let guess = plain(Some(unit)).filter(|guess| guess.quantity == Self::Of(Role::MotorPosition))?;
                let doubt = Doubt::Electrical;
                Some(Guess {
                    doubt,
                    ..guess.with_unit(unit)
                })
            }
            _ => plain(Some(unit)),
        }
    }

    /// What a column of this name and unit, if it has one, may be.
    fn guess_with(name: &str, unit: Option<&str>) -> Option<Guess> {
        let words = words(name);
        let plain = words.concat();
        let has = |parts: &[&str]| parts.iter().any(|part| plain.contains(part));
        let says = |known: &[&str]| words.iter().any(|word| known.contains(&word.as_str()));
        if has(&DERIVED) || says(&DERIVED_WORDS) {
            return None;
        }
        let params = ActuatorParams::bench();
        let fits = |quantity: Self| unit.is_none_or(|unit| quantity.dimension(&params).unit(unit).is_some());
        let of = |role: Role| Some(Self::Of(role)).filter(|quantity| fits(*quantity));
        let is_second = says(&SECOND);
        let guess = |quantity: Self, doubt: Doubt| {
            let doubt = doubt.max(if is_second { Doubt::Word } else { Doubt::None });
            let unit = None;
            Some(Guess { quantity, unit, doubt })
        };
        let is_command = has(&COMMANDED) || says(&COMMANDED_WORDS);
        let is_of_motor = has(&MOTOR) || says(&MOTOR_WORDS);
        let is_out = words
            .iter()
            .any(|word| word.starts_with("out") || word.ends_with("out"));
        let is_of_output = has(&OUTPUT) || is_out;
        let is_perhaps_output = !is_of_motor && has(&RATHER_OUTPUT);
        let is_perhaps_motor = !is_of_output && has(&RATHER_MOTOR);
        let is_angle = has(&ANGLE);
        if is_electrical(name) && !is_command && (is_angle || is_of_motor) {
            let quantity = of(Role::MotorPosition)?;
            return guess(quantity, Doubt::Electrical);
        }
        let named = NAMES
            .into_iter()
            .find(|(quantity, names)| names.contains(&plain.as_str()) && fits(*quantity));
        if let Some((quantity, _)) = named {
            let is_motor_alone = quantity == Self::Of(Role::WindingTemp) && is_of_motor;
            let is_weak = is_motor_alone || (is_perhaps_output && !is_of_output);
            return guess(quantity, if is_weak { Doubt::Word } else { Doubt::None });
        }
        if let Some(current) = current(&words).filter(|quantity| fits(*quantity)) {
            return guess(current, Doubt::None);
        }
        // A part of a name says something beside a unit, or a word for an angle, alone.
        let is_named_angle =
            is_angle && (is_command || is_of_motor || is_of_output || is_perhaps_output || is_perhaps_motor);
        if unit.is_none() && !is_named_angle {
            return None;
        }
        if is_command {
            return match of(Role::CommandPosition) {
                Some(position) if is_of_motor => guess(position, Doubt::OtherSide),
                Some(position) => guess(position, Doubt::None),
                None if is_of_output => guess(of(Role::CommandSpeed)?, Doubt::OtherSide),
                None => guess(of(Role::CommandSpeed)?, Doubt::None),
            };
        }
        if let Some(temperature) = of(Role::WindingTemp).filter(|_| unit.is_some()) {
            let is_winding = has(&WINDING);
            let is_one = (is_winding || is_of_motor) && !has(&BESIDE_WINDING);
            let doubt = if is_winding { Doubt::None } else { Doubt::Word };
            return is_one.then(|| guess(temperature, doubt))?;
        }
        if is_of_motor {
            guess(of(Role::MotorPosition)?, Doubt::None)
        } else if is_of_output {
            guess(of(Role::OutputPosition).or_else(|| of(Role::LoadTorque))?, Doubt::None)
        } else if is_perhaps_output {
            guess(of(Role::OutputPosition)?, Doubt::Word)
        } else if is_perhaps_motor {
            guess(of(Role::MotorPosition)?, Doubt::Word)
        } else {
            guess(
                of(Role::DcLink).filter(|_| has(&["dc", "bus", "link", "zwischenkreis"]))?,
                Doubt::None,
            )
        }
    }
}

impl Guess {
    fn with_unit(self, unit: &str) -> Self {
        let unit = Some(unit.to_owned());
        Self { unit, ..self }
    }
}

/// Whether a name says the electrical angle.
fn is_electrical(name: &str) -> bool {
    let words = words(name);
    let plain = words.concat();
    let is_angle = |word: &String| ANGLE.iter().any(|angle| word.contains(angle));
    let angle_of_e = words
        .windows(2)
        .any(|two| (two[1] == "e" && is_angle(&two[0])) || (two[0] == "e" && is_angle(&two[1])));
    angle_of_e
        || ELECTRICAL_ENDS.iter().any(|end| plain.ends_with(end))
        || words.iter().any(|word| {
            ELECTRICAL_WORDS.contains(&word.as_str()) || ELECTRICAL_STARTS.iter().any(|start| word.starts_with(start))
        })
}

/// The current that a name of several words means, as in `Phase U current`: what is left of it without the usual words.
fn current(words: &[String]) -> Option<Quantity> {
    let says_which = |word: &&String| {
        let word = word.as_str();
        !OF_CURRENTS.contains(&word) && !OF_SECOND_CURRENTS.contains(&word)
    };
    let mut left = words.iter().filter(says_which);
    let which = left.next().map_or("", String::as_str);
    let which = which.strip_prefix('i').filter(|rest| rest.len() == 1).unwrap_or(which);
    let is_current = words.len() > 1 && left.next().is_none();
    match which {
        _ if !is_current => None,
        "a" | "u" | "1" => Some(Quantity::Of(Role::CurrentA)),
        "b" | "v" | "2" => Some(Quantity::Of(Role::CurrentB)),
        "c" | "w" | "3" => Some(Quantity::Of(Role::CurrentC)),
        "d" => Some(Quantity::CurrentD),
        "q" => Some(Quantity::CurrentQ),
        _ => None,
    }
}

/// The words of a name in lower case: a capital letter behind a small one begins a word.
fn words(name: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let (mut goes_on, mut was_small) = (false, false);
    for c in name.chars() {
        if !c.is_alphanumeric() {
            goes_on = false;
            continue;
        }
        if !goes_on || (was_small && c.is_uppercase()) {
            words.push(String::new());
        }
        if let Some(word) = words.last_mut() {
            word.extend(c.to_lowercase());
        }
        (goes_on, was_small) = (true, c.is_lowercase() || c.is_numeric());
    }
    words
}

#[cfg(test)]
mod tests;

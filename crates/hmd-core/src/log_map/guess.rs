//! What a column may be, by its name and unit.

use ema_models::ActuatorParams;

use super::Quantity;
use crate::dbc::Role;

/// Names that are a quantity, in lower case without signs between their letters.
const NAMES: [(Quantity, &[&str]); 15] = [
    (Quantity::Time, &["t", "time", "timestamp", "timestamps", "zeit"]),
    (
        Quantity::Counter,
        &["seq", "counter", "samplecounter", "samplenumber", "cycle", "alive"],
    ),
    (
        Quantity::Of(Role::Time),
        &["clock", "timeus", "devicetime", "deviceclock"],
    ),
    (
        Quantity::Of(Role::CurrentA),
        &[
            "ia",
            "iu",
            "i1",
            "currenta",
            "currentu",
            "iphasea",
            "phaseacurrent",
            "currentphasea",
        ],
    ),
    (
        Quantity::Of(Role::CurrentB),
        &[
            "ib",
            "iv",
            "i2",
            "currentb",
            "currentv",
            "iphaseb",
            "phasebcurrent",
            "currentphaseb",
        ],
    ),
    (
        Quantity::Of(Role::CurrentC),
        &[
            "ic",
            "iw",
            "i3",
            "currentc",
            "currentw",
            "iphasec",
            "phaseccurrent",
            "currentphasec",
        ],
    ),
    (
        Quantity::CurrentD,
        &["id", "idact", "idmeas", "currentd", "idmeasured", "idactual"],
    ),
    (
        Quantity::CurrentQ,
        &["iq", "iqact", "iqmeas", "currentq", "iqmeasured", "iqactual"],
    ),
    (Quantity::MODE, &["mode", "state", "controlmode", "drivestate"]),
    (
        Quantity::Of(Role::DcLink),
        &["udc", "vdc", "vbus", "ubus", "dclink", "dclinkvoltage", "busvoltage"],
    ),
    (
        Quantity::Of(Role::WindingTemp),
        &[
            "tw",
            "windingtemp",
            "windingtemperature",
            "motortemp",
            "motortemperature",
            "tempmotor",
        ],
    ),
    (
        Quantity::Of(Role::LoadTorque),
        &["mload", "tload", "load", "loadtorque", "torqueload"],
    ),
    (
        Quantity::Of(Role::MotorPosition),
        &[
            "thetam",
            "motorangle",
            "motorposition",
            "motorpos",
            "motorcounts",
            "rotorangle",
            "resolver",
        ],
    ),
    (
        Quantity::Of(Role::OutputPosition),
        &[
            "thetao",
            "thetaout",
            "outputangle",
            "outputposition",
            "outputpos",
            "outputcounts",
            "encoder",
        ],
    ),
    (
        Quantity::Of(Role::CommandPosition),
        &[
            "phiset",
            "thetaset",
            "setpoint",
            "positionsetpoint",
            "commandposition",
            "positioncommand",
        ],
    ),
];

/// Parts of the names of what is commanded.
const COMMANDED: [&str; 7] = ["set", "cmd", "command", "demand", "target", "ref", "soll"];

/// Parts of the names of angles of the motor and of the output.
const MOTOR: [&str; 3] = ["motor", "rotor", "resolver"];
const OUTPUT: [&str; 12] = [
    "output", "shaft", "joint", "surface", "encoder", "load", "flap", "aileron", "elevator", "rudder", "spoiler",
    "slat",
];

/// Parts of the names of angles, which need no unit to say so.
const ANGLE: [&str; 7] = ["angle", "pos", "theta", "phi", "count", "enc", "resolver"];

/// Words in the names of currents that do not say which.
const OF_CURRENTS: [&str; 11] = [
    "current", "phase", "ph", "motor", "stator", "meas", "measured", "act", "actual", "foc", "i",
];

/// Units that names end with in lower case, too.
const UNITS: [&str; 9] = ["mA", "A", "mV", "V", "Nm", "degC", "rad/s", "counts", "Hz"];

impl Quantity {
    /// What a column of this name and unit may be; where it has no unit, also by the one that its name ends with, as in `iq_A` and
    /// `speed_rad_s`, and that unit.
    #[must_use]
    pub fn guess(name: &str, unit: Option<&str>) -> Option<(Self, Option<String>)> {
        let by_ending = || {
            name.match_indices('_').find_map(|(at, _)| {
                let ending = name[at + 1..].replace('_', "/");
                let known = UNITS.iter().find(|unit| unit.eq_ignore_ascii_case(&ending));
                let unit = known.map_or(ending.as_str(), |unit| *unit).to_owned();
                Some((Self::guess_with(&name[..at], Some(&unit))?, Some(unit)))
            })
        };
        // A group before the signal says little.
        let alone = name.rsplit(['.', '/', ':']).next().filter(|alone| !alone.is_empty());
        let plain = || {
            let of_alone = || Self::guess_with(alone?, unit);
            Some((Self::guess_with(name, unit).or_else(of_alone)?, None))
        };
        if unit.is_some() {
            plain()
        } else {
            by_ending().or_else(plain)
        }
    }

    /// What a column of this name and unit, if it has one, may be.
    fn guess_with(name: &str, unit: Option<&str>) -> Option<Self> {
        let plain: String = name
            .chars()
            .filter(|c| c.is_alphanumeric())
            .flat_map(char::to_lowercase)
            .collect();
        let params = ActuatorParams::bench();
        let fits = |quantity: Self| unit.is_none_or(|unit| quantity.dimension(&params).unit(unit).is_some());
        let named = NAMES
            .into_iter()
            .find(|(quantity, names)| names.contains(&plain.as_str()) && fits(*quantity));
        if let Some((quantity, _)) = named {
            return Some(quantity);
        }
        if let Some(current) = current(name).filter(|quantity| fits(*quantity)) {
            return Some(current);
        }
        let has = |parts: &[&str]| parts.iter().any(|part| plain.contains(part));
        // A part of a name says something beside a unit, or a word for an angle, alone.
        if unit.is_none() && !(has(&ANGLE) && (has(&MOTOR) || has(&OUTPUT)) && !has(&COMMANDED)) {
            return None;
        }
        let of = |role: Role| Some(Self::Of(role)).filter(|quantity| fits(*quantity));
        if has(&COMMANDED) {
            of(Role::CommandPosition).or_else(|| of(Role::CommandSpeed))
        } else if has(&MOTOR) {
            of(Role::MotorPosition).or_else(|| of(Role::WindingTemp))
        } else if has(&OUTPUT) {
            of(Role::OutputPosition).or_else(|| of(Role::LoadTorque))
        } else {
            of(Role::DcLink).filter(|_| has(&["dc", "bus", "link"]))
        }
    }
}

/// The current that a name of several words means, as in `Phase U current`: what is left of it without the usual words.
fn current(name: &str) -> Option<Quantity> {
    let words = words(name);
    let mut left = words.iter().filter(|word| !OF_CURRENTS.contains(&word.as_str()));
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
mod tests {
    use super::*;

    #[test]
    fn usual_names_are_recognised_and_units_decide() {
        let guess = |name: &str, unit: &str| {
            Quantity::guess(name, Some(unit).filter(|unit| !unit.is_empty())).map(|(quantity, _)| quantity)
        };
        assert_eq!(guess("I_A", "A"), Some(Quantity::Of(Role::CurrentA)));
        assert_eq!(guess("i.u", ""), Some(Quantity::Of(Role::CurrentA)));
        assert_eq!(guess("I_A", "V"), None);
        assert_eq!(guess("Motor_Angle", "deg"), Some(Quantity::Of(Role::MotorPosition)));
        assert_eq!(guess("motor_winding", "degC"), Some(Quantity::Of(Role::WindingTemp)));
        assert_eq!(guess("SpeedDemand", "rpm"), Some(Quantity::Of(Role::CommandSpeed)));
        assert_eq!(guess("elapsed", "ms"), None);
        assert_eq!(guess("Iq_act", "A"), Some(Quantity::CurrentQ));
    }

    #[test]
    fn names_of_several_words_and_groups_are_recognised() {
        let guess = |name: &str, unit: &str| {
            Quantity::guess(name, Some(unit).filter(|unit| !unit.is_empty())).map(|(quantity, _)| quantity)
        };
        let of = |role: Role| Some(Quantity::Of(role));
        for (name, unit, expected) in [
            ("Phase U current", "mA", of(Role::CurrentA)),
            ("PhaseCurrentB", "A", of(Role::CurrentB)),
            ("motor.i_w", "A", of(Role::CurrentC)),
            ("FOC.Id", "A", Some(Quantity::CurrentD)),
            ("FOC.Iq", "", Some(Quantity::CurrentQ)),
            ("ia_ma", "", of(Role::CurrentA)),
            ("LoadAngle", "deg", of(Role::OutputPosition)),
            ("LoadTorque", "Nm", of(Role::LoadTorque)),
            ("Flap_deg", "", of(Role::OutputPosition)),
            ("enc_motor", "", of(Role::MotorPosition)),
            ("motor_enable", "", None),
            ("phase", "deg", None),
            ("Flap_cmd_deg", "", of(Role::CommandPosition)),
        ] {
            assert_eq!(guess(name, unit), expected, "{name} [{unit}]");
        }
    }

    #[test]
    fn a_name_may_end_with_its_unit() {
        let guess = |name: &str| Quantity::guess(name, None);
        let with = |quantity, unit: &str| Some((quantity, Some(unit.to_owned())));
        assert_eq!(guess("time_s"), with(Quantity::Time, "s"));
        assert_eq!(guess("iq_A"), with(Quantity::CurrentQ, "A"));
        assert_eq!(guess("i_d_mA"), with(Quantity::CurrentD, "mA"));
        assert_eq!(guess("motor_angle_deg"), with(Quantity::Of(Role::MotorPosition), "deg"));
        assert_eq!(
            guess("speed_demand_rad_s"),
            with(Quantity::Of(Role::CommandSpeed), "rad/s")
        );
        assert_eq!(
            guess("I_A"),
            Some((Quantity::Of(Role::CurrentA), None)),
            "phase A, not ampere"
        );
        assert_eq!((guess("some_thing"), guess("_"), guess("é_°")), (None, None, None));
    }
}

//! Units of quantities on a bus, and their conversion to SI units.

use serde::Serialize;

/// Kind of quantity that a signal carries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Dimension {
    /// A.
    Current,
    /// Counts of a sensor, of which one turn has so many.
    Angle {
        /// Counts per turn.
        counts_per_rev: f64,
    },
    /// rad of a commanded angle.
    CommandedAngle,
    /// rad/s.
    Speed,
    /// µs.
    Time,
    /// V.
    Voltage,
    /// °C.
    Temperature,
    /// Nm.
    Torque,
    /// A number without unit.
    Number,
}

/// `internal value = scale · bus value + offset`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Unit {
    /// Scale: internal units per bus unit.
    pub scale: f64,
    /// Offset: internal value at zero on the bus.
    pub offset: f64,
}

impl Unit {
    /// Identity conversion.
    pub const SAME: Self = Self {
        scale: 1.0,
        offset: 0.0,
    };

    fn times(scale: f64) -> Self {
        Self { scale, offset: 0.0 }
    }

    /// Converts a value on the bus to the internal unit.
    #[must_use]
    pub fn to_internal(self, value: f64) -> f64 {
        value * self.scale + self.offset
    }
}

const TURN_RAD: f64 = core::f64::consts::TAU;

impl Dimension {
    /// Units by all names that they go by, for messages the best one first.
    fn units(self) -> Vec<(&'static [&'static str], Unit)> {
        let turns = |turn: f64| -> Vec<(&'static [&'static str], Unit)> {
            vec![
                (&["rad"], Unit::times(turn / TURN_RAD)),
                (&["mrad"], Unit::times(1e-3 * turn / TURN_RAD)),
                (&["urad", "µrad", "μrad"], Unit::times(1e-6 * turn / TURN_RAD)),
                (&["deg", "°", "degree", "degrees", "Deg"], Unit::times(turn / 360.0)),
                (&["rev", "turn", "turns"], Unit::times(turn)),
            ]
        };
        match self {
            Self::Current => vec![
                (&["A", "Amps", "amps", "Ampere"], Unit::SAME),
                (&["mA"], Unit::times(1e-3)),
            ],
            Self::Angle { counts_per_rev } => {
                let mut units = turns(counts_per_rev);
                units.push((&["counts", "count", "cts", "inc"], Unit::SAME));
                units
            }
            Self::CommandedAngle => turns(TURN_RAD),
            Self::Speed => vec![
                (&["rad/s"], Unit::SAME),
                (&["mrad/s"], Unit::times(1e-3)),
                (&["deg/s", "°/s"], Unit::times(TURN_RAD / 360.0)),
                (&["rev/s", "1/s", "Hz"], Unit::times(TURN_RAD)),
                (&["rpm", "1/min", "rev/min", "RPM"], Unit::times(TURN_RAD / 60.0)),
            ],
            Self::Time => vec![
                (&["us", "µs", "μs", "usec"], Unit::SAME),
                (&["ms", "msec"], Unit::times(1e3)),
                (&["s", "sec", "seconds"], Unit::times(1e6)),
                (&["ns"], Unit::times(1e-3)),
            ],
            Self::Voltage => vec![
                (&["V", "Volts", "Volt"], Unit::SAME),
                (&["mV"], Unit::times(1e-3)),
                (&["kV"], Unit::times(1e3)),
            ],
            Self::Temperature => vec![
                (&["degC", "°C", "C", "deg C"], Unit::SAME),
                (
                    &["K"],
                    Unit {
                        scale: 1.0,
                        offset: -273.15,
                    },
                ),
            ],
            Self::Torque => vec![
                (&["Nm", "N.m", "N·m", "N*m"], Unit::SAME),
                (&["mNm"], Unit::times(1e-3)),
            ],
            Self::Number => Vec::new(),
        }
    }

    /// The unit of this name; every name will do for a number without unit.
    #[must_use]
    pub fn unit(self, name: &str) -> Option<Unit> {
        if self == Self::Number {
            return Some(Unit::SAME);
        }
        let units = self.units();
        let found = units.iter().find(|(names, _)| names.contains(&name.trim()));
        found.map(|&(_, unit)| unit)
    }

    /// Names of the units, for a message.
    #[must_use]
    pub fn names(self) -> String {
        let first: Vec<_> = self.units().iter().map(|(names, _)| names[0]).collect();
        first.join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bus_values_become_internal_units() {
        let resolver = Dimension::Angle {
            counts_per_rev: 65_536.0,
        };
        let internal =
            |dimension: Dimension, unit: &str, value: f64| dimension.unit(unit).expect(unit).to_internal(value);
        let cases = [
            (internal(Dimension::Current, "mA", 1_500.0), 1.5),
            (internal(resolver, "deg", 90.0), 16_384.0),
            (internal(resolver, "rad", core::f64::consts::PI), 32_768.0),
            (internal(resolver, "counts", 7.0), 7.0),
            (internal(Dimension::CommandedAngle, "deg", 180.0), core::f64::consts::PI),
            (internal(Dimension::Speed, "rpm", 60.0), TURN_RAD),
            (internal(Dimension::Time, "ms", 2.0), 2_000.0),
            (internal(Dimension::Temperature, "K", 293.15), 20.0),
        ];
        for (found, expected) in cases {
            assert!((found - expected).abs() < 1e-9 * expected.abs(), "{found} {expected}");
        }
        assert_eq!(Dimension::Current.unit("V"), None);
        assert_eq!(Dimension::Current.names(), "A, mA");
    }
}

//! Effects as a command line or a file sets them: by name, in any order, checked together at the end.
//!
//! Input are a kind of drive and values by their names in [`EFFECTS`], output is [`Effects`]. [`Effects::set`] accepts each value
//! alone; here a value that would have no effect, or would change the drive unasked, is refused.

use core::fmt;

use super::effects::{Drive, EFFECTS, EffectError, Effects, VectorDrive};

/// Values by name and the kind of drive, not yet checked together.
///
/// ```
/// use ema_models::reference::{Drive, EffectSettings};
/// let mut settings = EffectSettings::default();
/// settings.set("dead_time_s", 1e-6).unwrap();
/// assert!(settings.effects().is_err(), "the hysteresis drive has no dead time");
/// settings.drive = Drive::from_name("vector");
/// assert_eq!(settings.effects().unwrap().vector_drive().unwrap().dead_time, 1e-6);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffectSettings {
    /// Kind of drive; `None` for the drive of the actuator's type, which also holds where it is of this kind. Another kind has its
    /// usual parameters.
    pub drive: Option<Drive>,
    /// Values in the order of [`EFFECTS`].
    values: [Option<f64>; EFFECTS.len()],
}

impl Default for EffectSettings {
    /// Everything off.
    fn default() -> Self {
        Self {
            drive: None,
            values: [None; EFFECTS.len()],
        }
    }
}

/// Why settings that are right alone are refused together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EffectConflict {
    /// A parameter of the vector drive, without this drive.
    NotVectorDrive(&'static str),
    /// A parameter of an effect, without this effect.
    WithoutEffect {
        /// The parameter.
        name: &'static str,
        /// The effect.
        part_of: &'static str,
    },
    /// A parameter of an effect whose value is that without the effect.
    EffectOff {
        /// The parameter.
        name: &'static str,
        /// The effect.
        part_of: &'static str,
    },
}

impl fmt::Display for EffectConflict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotVectorDrive(name) => {
                write!(f, "{name}: expected the vector drive, found the hysteresis drive")
            }
            Self::WithoutEffect { name, part_of } => {
                write!(f, "{name}: expected {part_of} as well, of which it is a parameter")
            }
            Self::EffectOff { name, part_of } => {
                write!(
                    f,
                    "{name}: expected {part_of}, of which it is a parameter, other than 0"
                )
            }
        }
    }
}

impl core::error::Error for EffectConflict {}

impl EffectSettings {
    /// This kind of drive, everything else off.
    #[must_use]
    pub fn with_drive(drive: Option<Drive>) -> Self {
        Self {
            drive,
            ..Self::default()
        }
    }

    /// Sets a value, in place of an earlier one of this name.
    ///
    /// # Errors
    /// An unknown name, or a value outside its range, as [`Effects::set`] refuses them.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), EffectError> {
        Effects::default().set(name, value)?;
        for (info, place) in EFFECTS.iter().zip(&mut self.values) {
            if info.name == name {
                *place = Some(value);
            }
        }
        Ok(())
    }

    /// The settings with those of `over` in place of their own.
    #[must_use]
    pub fn overridden_by(mut self, over: &Self) -> Self {
        self.drive = over.drive.or(self.drive);
        for (place, value) in self.values.iter_mut().zip(over.values) {
            *place = value.or(*place);
        }
        self
    }

    /// The effects of these settings on a unit whose type has the hysteresis drive.
    ///
    /// # Errors
    /// The first value without the drive or the effect that it is a parameter of.
    pub fn effects(&self) -> Result<Effects, EffectConflict> {
        self.effects_on(Drive::Hysteresis)
    }

    /// The effects of these settings on a unit whose type has this drive, see [`Drive::of_built_in`].
    ///
    /// # Errors
    /// The first value without the drive or the effect that it is a parameter of.
    pub fn effects_on(&self, drive_of_type: Drive) -> Result<Effects, EffectConflict> {
        // A kind that the type has too is the type's, with its carrier and bandwidth.
        let other_kind = self.drive.filter(|drive| drive.name() != drive_of_type.name());
        let mut effects = Effects {
            drive: other_kind.unwrap_or(drive_of_type),
            ..Effects::default()
        };
        for (info, value) in EFFECTS.iter().zip(self.values) {
            let Some(value) = value else { continue };
            let name = info.name;
            if let Some(part_of) = info.part_of {
                match self.is_on(part_of) {
                    None => return Err(EffectConflict::WithoutEffect { name, part_of }),
                    Some(false) => return Err(EffectConflict::EffectOff { name, part_of }),
                    Some(true) => {}
                }
            }
            let drive = effects.drive;
            // `Self::set` has accepted this value.
            let _ = effects.set(name, value);
            if drive.name() != effects.drive.name() {
                return Err(EffectConflict::NotVectorDrive(name));
            }
        }
        Ok(effects)
    }

    /// Whether the value of an effect differs from that without it, or is a rise of the temperature, of which 0 K is one of many; `None` where it
    /// is not set.
    fn is_on(&self, name: &str) -> Option<bool> {
        let mut values = EFFECTS.iter().zip(self.values);
        let value = values.find_map(|(info, value)| value.filter(|_| info.name == name))?;
        // Beside the vector drive, so that a parameter of it changes no kind.
        let without = Effects {
            drive: Drive::Vector(VectorDrive::default()),
            ..Effects::default()
        };
        let mut with = without;
        // `Self::set` has accepted this value.
        let _ = with.set(name, value);
        Some(with != without || name == "temperature_rise_k")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings<'a>(drive: Option<&str>, values: impl IntoIterator<Item = (&'a str, f64)>) -> EffectSettings {
        let mut settings = EffectSettings::with_drive(drive.and_then(Drive::from_name));
        for (name, value) in values {
            settings.set(name, value).unwrap();
        }
        settings
    }

    #[test]
    fn what_is_on_can_be_set_again() {
        let values = EFFECTS.iter().map(|info| (info.name, info.usual.1));
        let effects = settings(Some("vector"), values).effects().unwrap();
        let again = settings(Some(effects.drive.name()), effects.active());
        assert_eq!(again.effects(), Ok(effects));
        assert_eq!(EffectSettings::default().effects(), Ok(Effects::default()));
    }

    #[test]
    fn the_drive_of_the_type_holds_where_none_is_set() {
        let on_type = Drive::of_built_in("servo270");
        let effects = |drive, values: &[(&str, f64)]| settings(drive, values.iter().copied()).effects_on(on_type);
        assert_eq!(effects(None, &[]).unwrap().drive, on_type);
        let late = effects(None, &[("dead_time_s", 1e-6)]).unwrap();
        let drive = late.vector_drive().unwrap();
        assert_eq!((drive.pwm_frequency, drive.dead_time), (16e3, 1e-6));
        assert_eq!(effects(Some("vector"), &[]).unwrap().drive, on_type);
        assert_eq!(effects(Some("hysteresis"), &[]), Ok(Effects::default()));
    }

    #[test]
    fn an_effect_at_its_value_without_effect_is_off_and_has_no_parameters() {
        for info in EFFECTS {
            let Some(part_of) = info.part_of else { continue };
            let name = info.name;
            let together = |value| settings(Some("vector"), [(part_of, value), (name, info.usual.1)]).effects();
            let effect = EFFECTS.iter().find(|effect| effect.name == part_of).unwrap();
            assert!(together(effect.usual.1).is_ok(), "{name}");
            if matches!(part_of, "short_resistance_ohm" | "temperature_rise_k") {
                // Turns that are shorted without resistance; the temperature of the scenario.
                assert!(together(0.0).is_ok());
                continue;
            }
            assert_eq!(together(0.0), Err(EffectConflict::EffectOff { name, part_of }));
            let alone = settings(Some("vector"), [(part_of, 0.0)]).effects();
            assert_eq!(alone, settings(Some("vector"), []).effects());
        }
    }

    #[test]
    fn a_parameter_needs_its_drive_and_its_effect() {
        for drive in [None, Some("hysteresis")] {
            let conflict = settings(drive, [("decoupling", 0.5)]).effects().unwrap_err();
            assert_eq!(conflict, EffectConflict::NotVectorDrive("decoupling"));
        }
        for info in EFFECTS {
            let Some(part_of) = info.part_of else { continue };
            let name = info.name;
            let alone = settings(Some("vector"), [(name, info.usual.1)]);
            assert_eq!(alone.effects(), Err(EffectConflict::WithoutEffect { name, part_of }));
        }
    }

    #[test]
    fn later_settings_override_earlier_ones() {
        let file = settings(Some("vector"), [("cogging_nm", 0.1), ("emf_5", 0.02)]);
        let line = settings(Some("hysteresis"), [("cogging_nm", 0.2)]);
        let both = file.overridden_by(&line);
        assert_eq!(
            both,
            settings(Some("hysteresis"), [("cogging_nm", 0.2), ("emf_5", 0.02)])
        );
        assert_eq!(file.overridden_by(&EffectSettings::default()), file);
    }

    #[test]
    fn a_refused_value_changes_nothing() {
        let mut settings = EffectSettings::default();
        assert!(settings.set("coging_nm", 0.1).is_err() && settings.set("cogging_nm", f64::NAN).is_err());
        assert_eq!(settings, EffectSettings::default());
    }
}

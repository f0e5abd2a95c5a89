//! The simulated windows of the suite without the pipeline: scenarios of a unit by name of its entry and type.

use ema_models::reference::{Effects, Scenario};
use ema_models::{ActuatorParams, DriveParams, FaultVector, Profile};
use hmd_core::seed::{mix, name_hash};

use super::entries::ENTRIES;
use super::unit::{draw_effects, scenario, single_fault};
use super::{FAULTY_PER_HEALTHY, RobustError};

/// One unit of the catalogue.
#[derive(Clone, Debug)]
pub struct CatalogueUnit {
    /// The type at the sample rate of the suite.
    pub nominal: ActuatorParams,
    /// What the unit has besides.
    pub effects: Effects,
    seed: u64,
}

impl CatalogueUnit {
    /// The unit that the suite draws for an entry and a built-in type.
    ///
    /// # Errors
    /// An unknown entry or type, an impossible rate.
    pub fn new(entry: &str, actuator: &str, rate_hz: f64, seed: u64) -> Result<Self, RobustError> {
        let found = || entry.to_owned();
        let known = ENTRIES.iter().find(|known| known.name == entry);
        let known = known.ok_or_else(|| RobustError::Entry { found: found() })?;
        let mut nominal = ActuatorParams::built_in(actuator).ok_or_else(|| RobustError::Actuator {
            found: actuator.to_owned(),
        })?;
        nominal.sensors.sample_rate = rate_hz;
        let nominal = nominal.checked()?;
        Ok(Self {
            nominal,
            effects: draw_effects(known, &nominal, &DriveParams::of_built_in(actuator), seed)?,
            seed: mix(seed, &[name_hash(entry), name_hash(actuator)]),
        })
    }

    /// Place of the damaged element and scenario of a window as the suite numbers them: `n` healthy ones, twice as many faulty
    /// ones, then those of commissioning.
    #[must_use]
    pub fn window(&self, number: u64, n: u64) -> (Option<usize>, Scenario) {
        let seed = mix(self.seed, &[2, number]);
        let (place, fault) = if (n..(1 + FAULTY_PER_HEALTHY) * n).contains(&number) {
            let (place, fault) = single_fault(number - n, seed);
            (Some(place), fault)
        } else {
            (None, FaultVector::NOMINAL)
        };
        (place, scenario(self.nominal, self.effects, Profile::Mixed, fault, seed))
    }
}

//! Drives as they are sold, on CAN: which of their frames are the quantities of one actuator.
//!
//! ```text
//! preset, EDS or DCF, overheard SDO ─ DriveLayout ─┐
//! RawFrame ────────────────────────── DriveJoiner ─┴─ rows ─ log_map::RowDecoder ─> Sample, MeasuredConditions
//! ```
//!
//! Such a drive sends currents in its rotor's frame, counts no samples and has no clock, so its frames become rows as a log of measured
//! signals has them, numbered by their stamps; what it lacks is said as of a log ([`crate::log_map::Gap`]). Its set point is overheard:
//! frames to the drive. Nothing is ever sent. Each preset: `docs/drives.md`.

mod cia402;
mod damiao;
mod eds;
mod joiner;
mod layout;
mod moteus;
mod node;
mod odrive;
mod other_frames;
mod pdo;
mod rows;
mod sdo;
mod vesc;

pub use eds::{EDS_BYTES_MAX, EdsError, ObjectDictionary};
pub use joiner::DriveJoiner;
pub use layout::{Coding, DriveLayout, DriveMessage, Field, Place, Target};

use std::ops::RangeInclusive;
use std::sync::Arc;

use ema_models::ActuatorParams;
use serde::Serialize;

use crate::dbc::Unit;
use crate::log_map::{LogMap, LogMisfit, Quantity};

/// Whose frames they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// A drive of CiA 402 on CANopen.
    Cia402,
    /// ODrive, CANSimple.
    Odrive,
    /// moteus, multiplex frames of registers.
    Moteus,
    /// VESC, status frames.
    Vesc,
    /// Damiao, feedback frames.
    Damiao,
}

impl Preset {
    /// All of them by name.
    pub const NAMES: [(&'static str, Self); 5] = [
        ("cia402", Self::Cia402),
        ("odrive", Self::Odrive),
        ("moteus", Self::Moteus),
        ("vesc", Self::Vesc),
        ("damiao", Self::Damiao),
    ];

    /// Its name in the configuration.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES
            .iter()
            .find(|(_, of)| *of == self)
            .map_or("", |(name, _)| name)
    }

    /// Numbers that a node may have.
    #[must_use]
    pub fn nodes(self) -> RangeInclusive<u32> {
        match self {
            Self::Odrive => 0..=odrive::NODE_MAX,
            Self::Vesc => 0..=vesc::NODE_MAX,
            Self::Cia402 | Self::Moteus | Self::Damiao => 1..=127,
        }
    }

    /// Numbers that a second encoder may have: a sub-index, a slot, an endpoint.
    #[must_use]
    pub fn output_encoders(self) -> RangeInclusive<u32> {
        match self {
            Self::Cia402 => 1..=0xFE,
            Self::Moteus => 0..=moteus::ENCODER_SLOTS - 1,
            Self::Odrive | Self::Vesc | Self::Damiao => 0..=u32::from(u16::MAX),
        }
    }
}

/// Section `[actuator.drive]`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DriveSettings {
    /// Whose frames they are.
    pub preset: Preset,
    /// Number of the node.
    pub node: u8,
    /// Steps of its position in one turn of the motor; `None`: as the preset or its file has them.
    pub motor_units_per_rev: Option<f64>,
    /// Which second encoder is at the output, as the preset numbers them; `None`: none.
    pub output_encoder: Option<u16>,
    /// Steps of that one in one turn of the output, negative where it counts the other way; `None`: as above.
    pub output_units_per_rev: Option<f64>,
    /// Peak of i_q at 1000 ‰ of CiA 402, at the largest torque of Damiao, A.
    pub rated_current_a: Option<f64>,
    /// Largest position of Damiao, rad at the output; `None`: the factory's.
    pub position_max_rad: Option<f64>,
    /// Identifier of the feedback of Damiao; `None`: the factory's.
    pub feedback_id: Option<u16>,
    /// Whether overheard commands are the set point.
    pub uses_commands: bool,
    /// Bandwidth of its filter of the currents, Hz, where that is known.
    pub current_bandwidth_hz: Option<u32>,
}

impl DriveSettings {
    /// A node of a preset, all else as the preset has it.
    #[must_use]
    pub fn new(preset: Preset, node: u8) -> Self {
        Self {
            preset,
            node,
            motor_units_per_rev: None,
            output_encoder: None,
            output_units_per_rev: None,
            rated_current_a: None,
            position_max_rad: None,
            feedback_id: None,
            uses_commands: true,
            current_bandwidth_hz: None,
        }
    }
}

/// The drive of one actuator.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DriveBus {
    settings: DriveSettings,
    #[serde(skip)]
    params: ActuatorParams,
    /// Of CiA 402: what its file says, and what was overheard.
    #[serde(skip)]
    dictionary: ObjectDictionary,
    layout: DriveLayout,
    /// As the columns of a log; what a drive of CiA 402 still lacks, which its master may yet write.
    #[serde(skip)]
    map: Result<Arc<LogMap>, DriveMisfit>,
}

/// Why a drive cannot be read. Displays as what is expected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DriveMisfit {
    /// A quantity is missing.
    #[error(transparent)]
    Log(#[from] LogMisfit),
    /// What neither the configuration nor, of CiA 402, the EDS file has.
    #[error("{0}, in [actuator.drive] or, of CiA 402, in the EDS file")]
    Unknown(&'static str),
    /// The mapping of a PDO.
    #[error(transparent)]
    Pdo(#[from] pdo::PdoError),
}

impl DriveBus {
    /// The drive with these settings; of CiA 402 with what its file says, which may be nothing.
    ///
    /// # Errors
    /// [`DriveMisfit`] of a drive whose frames do not depend on what is written to it.
    pub fn new(
        settings: DriveSettings,
        params: &ActuatorParams,
        dictionary: ObjectDictionary,
    ) -> Result<Self, DriveMisfit> {
        let mut drive = Self {
            settings,
            params: *params,
            dictionary,
            layout: DriveLayout::new(),
            map: Err(DriveMisfit::Pdo(pdo::PdoError::None)),
        };
        drive.lay_out();
        match &drive.map {
            // What a drive of CiA 402 lacks its master may yet write.
            Err(misfit) if drive.settings.preset != Preset::Cia402 => Err(misfit.clone()),
            _ => Ok(drive),
        }
    }

    fn lay_out(&mut self) {
        let (settings, params) = (&self.settings, &self.params);
        let layout = match settings.preset {
            Preset::Cia402 => cia402::layout(settings, params, &self.dictionary),
            Preset::Odrive => Ok(odrive::layout(settings, params)),
            Preset::Moteus => Ok(moteus::layout(settings, params)),
            Preset::Vesc => Ok(vesc::layout(settings, params)),
            Preset::Damiao => damiao::layout(settings, params),
        };
        let mapped = layout.and_then(|layout| {
            let map = layout.log_map()?;
            let map = map.with_current_bandwidth(settings.current_bandwidth_hz);
            Ok((Arc::new(map), layout))
        });
        self.map = mapped.map(|(map, layout)| {
            self.layout = layout;
            map
        });
    }

    /// Its settings.
    #[must_use]
    pub fn settings(&self) -> &DriveSettings {
        &self.settings
    }

    /// Its frames.
    #[must_use]
    pub fn layout(&self) -> &DriveLayout {
        &self.layout
    }

    /// The step of a sampled quantity in the drive's frames, in its internal unit (A, counts); `None` where it has no fixed number of bits there.
    #[must_use]
    pub fn step(&self, quantity: Quantity) -> Option<f64> {
        let (place, unit) = self.place_of(quantity)?;
        Some((place.step()? * unit.scale).abs())
    }

    /// Magnitude of the quadrature current, A, from which on its field is at an end of its range, where the frames have no direct one; `None` where the
    /// field has no fixed number of bits.
    #[must_use]
    pub fn quadrature_max(&self) -> Option<f64> {
        if self.place_of(Quantity::CurrentD).is_some() {
            return None;
        }
        let (place, unit) = self.place_of(Quantity::CurrentQ)?;
        let [first, last] = place.ends()?.map(|end| unit.to_internal(end).abs());
        Some(first.min(last) - 0.5 * self.step(Quantity::CurrentQ)?)
    }

    /// Where a sampled quantity is in the frames, and its unit there.
    fn place_of(&self, quantity: Quantity) -> Option<(&Place, Unit)> {
        let fields = self.layout.messages.iter().flat_map(|message| &message.fields);
        let mut places = fields.filter_map(|field| {
            let Target::Column(column) = field.target else {
                return None;
            };
            let column = self.layout.columns.get(column).filter(|of| of.quantity == quantity)?;
            Some((&field.place, column.conversion(None, &self.params).ok()?))
        });
        places.next()
    }

    /// Its quantities, as the columns of a log.
    ///
    /// # Errors
    /// What a drive of CiA 402 lacks so far.
    pub fn map(&self) -> Result<&Arc<LogMap>, &DriveMisfit> {
        self.map.as_ref()
    }
}

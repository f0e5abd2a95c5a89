//! Types of actuators: the built-in ones and every `[type.NAME]`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use ema_models::{ActuatorParams, DriveParams, Tolerances};
use serde::{Serialize, Serializer};

use super::ConfigError;
use super::drive;
use super::name::{NAME_EXPECTED, is_name};
use super::params::{self, GROUPS};
use super::reader::Section;
use super::specification::Specification;
use super::tolerances;

/// Type of an actuator that names none.
pub(super) const DEFAULT_TYPE: &str = "bench";

/// What is known of one type of actuator.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ActuatorType {
    /// Its physics; serialised under the keys of the file.
    #[serde(flatten, serialize_with = "as_file_keys")]
    pub params: ActuatorParams,
    /// How well the parameters are known.
    #[serde(
        skip_serializing_if = "tolerances::are_default",
        serialize_with = "tolerances::as_file_keys"
    )]
    pub tolerances: Tolerances,
    /// Its power electronics.
    #[serde(serialize_with = "drive::as_file_keys")]
    pub drive: DriveParams,
    /// Calibration of the monitor against the reference for this type, as written in the file; see
    /// [`Config::resolve`](super::Config::resolve).
    pub calibration: Option<PathBuf>,
    /// What it must still do when it is worn.
    pub specification: Specification,
    /// Where its values come from. Not part of the hash.
    #[serde(skip)]
    pub(super) origins: Origins,
}

/// Where the values of a type come from.
#[derive(Clone, Debug)]
pub(super) struct Origins {
    /// The built-in type that it starts from.
    pub(super) built_in: &'static str,
    /// Whether the file has a section of it.
    pub(super) is_configured: bool,
    /// The word for the tolerances that it does not set.
    pub(super) tolerances: &'static str,
    /// File and line of what the file sets, by group and key.
    pub(super) places: BTreeMap<(&'static str, String), String>,
}

/// Two files that mean the same are equal, wherever their values come from.
impl PartialEq for Origins {
    fn eq(&self, _other: &Self) -> bool {
        true
    }
}

impl ActuatorType {
    /// Its parameters and drive under their keys, whatever the sample rate; two types with the same text are the same.
    #[must_use]
    pub fn parameters_as_text(&self) -> String {
        parameters_as_text(&self.params, &self.drive)
    }
}

pub(super) fn parameters_as_text(params: &ActuatorParams, drive: &DriveParams) -> String {
    let mut params = *params;
    params.sensors.sample_rate = 0.0;
    format!("{:?} {}", params::by_key(&params), drive::as_text(drive))
}

/// The built-in types by name.
fn built_in() -> [(&'static str, ActuatorParams); 3] {
    [
        (DEFAULT_TYPE, ActuatorParams::bench()),
        ("servo28", ActuatorParams::servo28()),
        ("servo270", ActuatorParams::servo270()),
    ]
}

/// Built-in and configured types by name.
pub(super) fn read_all(root: &Section<'_>) -> Result<BTreeMap<String, ActuatorType>, ConfigError> {
    let built_in = built_in();
    let mut types: BTreeMap<_, _> = built_in
        .map(|(name, params)| {
            (
                name.to_owned(),
                ActuatorType {
                    params,
                    tolerances: tolerances::DEFAULT,
                    drive: DriveParams::of_built_in(name),
                    calibration: None,
                    specification: Specification::default(),
                    origins: Origins {
                        built_in: name,
                        is_configured: false,
                        tolerances: tolerances::word(&tolerances::DEFAULT),
                        places: BTreeMap::new(),
                    },
                },
            )
        })
        .into();
    let keys = [
        &["based_on", "calibration", "drive", "specification", "tolerances"],
        GROUPS.as_slice(),
    ]
    .concat();
    for (name, section) in root.named_sections("type", &keys)? {
        if !is_name(name) {
            return Err(section.refuse_self(NAME_EXPECTED, name));
        }
        // A type of a built-in name starts from that one; any other must say what it starts from.
        let own = built_in
            .iter()
            .find(|(built_in, _)| *built_in == name)
            .map(|base| Some(*base));
        let choices = built_in.map(|base| (base.0, Some(base)));
        let base = section.choice("based_on", own.flatten(), &choices)?;
        let Some((base_name, base)) = base else {
            return Err(section.refuse("based_on", "\"bench\", \"servo28\" or \"servo270\""));
        };
        let known_within = tolerances::base(&section)?;
        let (params, tolerances) = params::read(&section, base, known_within)?;
        let drive = drive::read(&section, DriveParams::of_built_in(base_name))?;
        let calibration = section.text("calibration")?.map(PathBuf::from);
        let specification = Specification::read(&section.section("specification", Specification::KEYS)?, &params)?;
        let mut places = BTreeMap::new();
        for group in GROUPS.into_iter().chain(["drive"]) {
            // Its keys were checked above.
            if let Some(set) = section.table(group)? {
                places.extend(set.places().map(|(key, place)| ((group, key.to_owned()), place)));
            }
        }
        let found = ActuatorType {
            params,
            tolerances,
            drive,
            calibration,
            specification,
            origins: Origins {
                built_in: base_name,
                is_configured: true,
                tolerances: tolerances::word(&known_within),
                places,
            },
        };
        types.insert(name.to_owned(), found);
    }
    Ok(types)
}

fn as_file_keys<S: Serializer>(params: &ActuatorParams, serializer: S) -> Result<S::Ok, S::Error> {
    params::by_key(params).serialize(serializer)
}

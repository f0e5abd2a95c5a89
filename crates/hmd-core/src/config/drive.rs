//! The drive of a type: `[type.NAME.drive]`.

use ema_models::{DriveKind, DriveParams};
use serde::{Serialize, Serializer};

use super::ConfigError;
use super::reader::Section;

/// One parameter of the vector drive.
struct Param {
    key: &'static str,
    range: [f64; 2],
    place: fn(&mut DriveParams) -> &mut Option<f64>,
}

const PARAMS: [Param; 4] = [
    Param {
        key: "pwm_frequency_hz",
        range: [2e3, 1e5],
        place: |drive| &mut drive.pwm_frequency,
    },
    Param {
        key: "current_bandwidth_hz",
        range: [10.0, 5e3],
        place: |drive| &mut drive.current_bandwidth,
    },
    Param {
        key: "dead_time_s",
        range: [0.0, 5e-6],
        place: |drive| &mut drive.dead_time,
    },
    Param {
        key: "decoupling",
        range: [0.0, 1.0],
        place: |drive| &mut drive.decoupling,
    },
];

/// The drive of a type whose base has the drive `base`; another kind than that of the base starts with nothing known.
pub(super) fn read(type_section: &Section<'_>, base: DriveParams) -> Result<DriveParams, ConfigError> {
    let keys: Vec<&str> = std::iter::once("kind")
        .chain(PARAMS.iter().map(|param| param.key))
        .collect();
    let section = type_section.section("drive", &keys)?;
    let kind = section.choice("kind", base.kind, &DriveKind::NAMES)?;
    let mut drive = if kind == base.kind {
        base
    } else {
        DriveParams {
            kind,
            ..DriveParams::default()
        }
    };
    for param in &PARAMS {
        if !section.has(param.key) {
            continue;
        }
        if kind != DriveKind::Vector {
            return Err(section.refuse(param.key, "no such key beside kind = \"hysteresis\""));
        }
        let [min, max] = param.range;
        *(param.place)(&mut drive) = Some(section.number(param.key, min, min..=max)?);
    }
    Ok(drive)
}

/// The drive as the file would spell it, without what is not known.
#[derive(Debug, Serialize)]
struct FileKeys {
    kind: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pwm_frequency_hz: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    current_bandwidth_hz: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    dead_time_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    decoupling: Option<f64>,
}

impl From<&DriveParams> for FileKeys {
    fn from(drive: &DriveParams) -> Self {
        Self {
            kind: drive.kind.name(),
            pwm_frequency_hz: drive.pwm_frequency,
            current_bandwidth_hz: drive.current_bandwidth,
            dead_time_s: drive.dead_time,
            decoupling: drive.decoupling,
        }
    }
}

pub(super) fn as_file_keys<S: Serializer>(drive: &DriveParams, serializer: S) -> Result<S::Ok, S::Error> {
    FileKeys::from(drive).serialize(serializer)
}

/// Group, key and value of what is known of a vector drive.
pub(super) fn listed(drive: &DriveParams) -> impl Iterator<Item = (&'static str, &'static str, f64)> {
    let mut drive = *drive;
    PARAMS
        .iter()
        .filter_map(move |param| Some(("drive", param.key, (*(param.place)(&mut drive))?)))
}

/// The drive under its keys.
pub(super) fn as_text(drive: &DriveParams) -> String {
    format!("{:?}", FileKeys::from(drive))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    fn drive_of(text: &str) -> Result<DriveParams, String> {
        let config = Config::from_toml_str(text, "hmd.toml").map_err(|e| e.to_string())?;
        Ok(config.actuator_type("own").unwrap().drive)
    }

    #[test]
    fn a_type_has_the_drive_of_its_base_or_its_own() {
        let of_servo270 = drive_of("[type.own]\nbased_on = \"servo270\"").unwrap();
        assert_eq!(of_servo270, DriveParams::of_built_in("servo270"));
        let late = drive_of("[type.own]\nbased_on = \"servo270\"\ndrive = { dead_time_s = 1e-6 }").unwrap();
        assert_eq!((late.pwm_frequency, late.dead_time), (Some(16e3), Some(1e-6)));
        let vector = drive_of("[type.own]\nbased_on = \"bench\"\ndrive = { kind = \"vector\" }").unwrap();
        assert_eq!((vector.kind, vector.pwm_frequency), (DriveKind::Vector, None));
    }

    #[test]
    fn impossible_drives_are_refused_by_key() {
        for (drive, key) in [
            ("kind = \"trapezoidal\"", "drive.kind"),
            ("pwm_frequency_hz = 2e4", "drive.pwm_frequency_hz"),
            ("kind = \"vector\", dead_time_s = 1e-3", "drive.dead_time_s"),
            ("kind = \"vector\", decoupling = nan", "drive.decoupling"),
            ("kind = \"vector\", pwm = 2e4", "drive"),
        ] {
            let refused = drive_of(&format!("[type.own]\nbased_on = \"bench\"\ndrive = {{ {drive} }}")).unwrap_err();
            assert!(refused.contains(key), "{drive}: {refused}");
        }
    }
}

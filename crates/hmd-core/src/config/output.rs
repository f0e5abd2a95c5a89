//! Section `[output]`: what is written besides the results, and how much of it is kept in a folder.

use serde::Serialize;

use super::ConfigError;
use super::reader::Section;
use super::storage_limits::Limits;

/// What is written besides the results.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OutputConfig {
    /// Store every frame as received, so that the log can be replayed.
    pub raw_frames: bool,
    /// Without `raw_frames`: store the frames around windows that matter.
    pub captures: bool,
    /// Time before the first sample of such a window whose frames are stored as well, s.
    pub capture_before_s: f64,
    /// Time after its last sample, s.
    pub capture_after_s: f64,
    /// Size at which a segment is closed, MiB.
    pub segment_mib: u32,
    /// Age at which a segment is closed, s.
    pub segment_age_s: u32,
    /// Most that all segments take together, MiB.
    pub disk_budget_mib: u32,
    /// What shall stay free on the disk, MiB.
    pub disk_free_min_mib: u32,
}

impl Default for OutputConfig {
    fn default() -> Self {
        Self {
            raw_frames: true,
            captures: true,
            capture_before_s: 2.0,
            capture_after_s: 1.0,
            segment_mib: 16,
            segment_age_s: 3600,
            disk_budget_mib: 2048,
            disk_free_min_mib: 256,
        }
    }
}

impl OutputConfig {
    pub(super) const KEYS: &'static [&'static str] = &[
        "raw_frames",
        "captures",
        "capture_before_s",
        "capture_after_s",
        "segment_mib",
        "segment_age_s",
        "disk_budget_mib",
        "disk_free_min_mib",
    ];

    pub(super) fn read(section: &Section<'_>) -> Result<Self, ConfigError> {
        let default = Self::default();
        let integer = |key, range, default| Ok(section.integer(key, range)?.unwrap_or(default));
        let output = Self {
            raw_frames: section.flag("raw_frames", default.raw_frames)?,
            captures: section.flag("captures", default.captures)?,
            capture_before_s: section.number("capture_before_s", default.capture_before_s, 0.0..=30.0)?,
            capture_after_s: section.number("capture_after_s", default.capture_after_s, 0.0..=30.0)?,
            segment_mib: integer("segment_mib", 1..=1024, default.segment_mib)?,
            segment_age_s: integer("segment_age_s", 10..=86_400, default.segment_age_s)?,
            disk_budget_mib: integer("disk_budget_mib", 4..=1 << 30, default.disk_budget_mib)?,
            disk_free_min_mib: integer("disk_free_min_mib", 0..=1 << 30, default.disk_free_min_mib)?,
        };
        // One of each kind in progress, and one of each that is kept.
        if output.disk_budget_mib / 4 < output.segment_mib {
            let expected = format!("at least four times segment_mib = {}", output.segment_mib);
            let effective = format!("{} (by default)", output.disk_budget_mib);
            return Err(section.refuse_effective("disk_budget_mib", &expected, &effective));
        }
        Ok(output)
    }

    /// The limits of a folder of segments.
    #[must_use]
    pub fn limits(&self) -> Limits {
        Limits::new(
            self.segment_mib,
            self.segment_age_s,
            self.disk_budget_mib,
            self.disk_free_min_mib,
        )
    }
}

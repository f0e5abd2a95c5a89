//! The columns of both tables, with their units, and how a record becomes a row.

use ema_models::{SensedSample, Setpoint};

use hmd_core::record::{Health, Rul, Window};
use hmd_core::sample::{MeasuredConditions, SampleRate};
use hmd_core::window::TimedSample;

/// Which table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum TableKind {
    /// A row for each window: health, fault vector, damage, remaining life.
    Health,
    /// A row for each stored sample of each window: setpoint, measured and fitted signals.
    Samples,
}

/// One cell.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// UTC, ns.
    Time(u64),
    /// A count.
    Count(u64),
    /// A count that may be negative.
    Signed(i64),
    /// Text.
    Text(String),
    /// Yes or no, or neither.
    Flag(Option<bool>),
    /// A number, or none.
    Number(Option<f64>),
}

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// [`Value::Time`].
    Time,
    /// [`Value::Count`].
    Count,
    /// [`Value::Signed`].
    Signed,
    /// [`Value::Text`].
    Text,
    /// [`Value::Flag`].
    Flag,
    /// [`Value::Number`].
    Number,
}

impl Kind {
    /// Whether a cell of the column may be empty.
    #[must_use]
    pub fn may_be_absent(self) -> bool {
        matches!(self, Self::Flag | Self::Number)
    }
}

/// Head of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Head {
    /// Its name, that of the record's field.
    pub name: &'static str,
    /// Its unit; `1` for a ratio, empty where there is none.
    pub unit: &'static str,
    /// What it holds.
    pub kind: Kind,
}

/// Where a row comes from: two units may have the same name.
#[derive(Clone, Copy, Debug, Default)]
pub struct Origin<'a> {
    /// Serial number of the actuator; empty where the recording has none.
    pub serial_number: &'a str,
    /// Name of the file that was read: the recording, or the log.
    pub file: &'a str,
}

impl TableKind {
    /// The columns.
    #[must_use]
    pub fn heads(self) -> Vec<Head> {
        match self {
            Self::Health => heads(
                &HEALTH,
                &health_row(&Health::default(), &Rul::default(), Origin::default()),
            ),
            Self::Samples => heads(&SAMPLES, &sample_row(&Window::default(), 0, Origin::default())),
        }
    }
}

/// Names and units beside what a row holds.
fn heads(columns: &[(&'static str, &'static str)], row: &[Value]) -> Vec<Head> {
    let head = |(&(name, unit), value): (&(&'static str, &'static str), &Value)| Head {
        name,
        unit,
        kind: match value {
            Value::Time(_) => Kind::Time,
            Value::Count(_) => Kind::Count,
            Value::Signed(_) => Kind::Signed,
            Value::Text(_) => Kind::Text,
            Value::Flag(_) => Kind::Flag,
            Value::Number(_) => Kind::Number,
        },
    };
    columns.iter().zip(row).map(head).collect()
}

/// One table of columns: name, unit, value.
macro_rules! columns {
    ($(#[$meta:meta])* $names:ident, $vis:vis fn $row:ident($($arg:ident: $type:ty),*), $count:literal: $($name:literal $unit:literal $value:expr;)*) => {
        const $names: [(&str, &str); $count] = [$(($name, $unit)),*];

        $(#[$meta])*
        #[must_use]
        $vis fn $row($($arg: $type),*) -> Vec<Value> {
            use Value::{Count, Number, Text, Time};
            vec![$($value),*]
        }
    };
}

columns! {
    /// Results of one window.
    HEALTH, pub fn health_row(health: &Health, rul: &Rul, origin: Origin<'_>), 95:
    "t_start_ns" "ns, UTC" Time(health.t_start_ns);
    "actuator" "" Text(health.actuator.clone());
    "window" "" Count(health.window);
    "status" "" Text(health.status.clone());
    "reason" "" Text(health.reason.clone());
    "health" "" Text(health.health.clone());
    "faults" "" Text(health.faults.clone());
    "k1" "1" Number(health.k1);
    "k2" "1" Number(health.k2);
    "k3" "1" Number(health.k3);
    "k4" "1" Number(health.k4);
    "k5" "1" Number(health.k5);
    "k6" "1" Number(health.k6);
    "k7" "1" Number(health.k7);
    "k8" "1" Number(health.k8);
    "k1_sigma" "1" Number(health.k1_sigma);
    "k2_sigma" "1" Number(health.k2_sigma);
    "k3_sigma" "1" Number(health.k3_sigma);
    "k4_sigma" "1" Number(health.k4_sigma);
    "k5_sigma" "1" Number(health.k5_sigma);
    "k6_sigma" "1" Number(health.k6_sigma);
    "k7_sigma" "1" Number(health.k7_sigma);
    "k8_sigma" "1" Number(health.k8_sigma);
    "k1_observable" "" Value::Flag(health.k1.map(|_| health.k1_observable));
    "k2_observable" "" Value::Flag(health.k2.map(|_| health.k2_observable));
    "k3_observable" "" Value::Flag(health.k3.map(|_| health.k3_observable));
    "k4_observable" "" Value::Flag(health.k4.map(|_| health.k4_observable));
    "k5_observable" "" Value::Flag(health.k5.map(|_| health.k5_observable));
    "k6_observable" "" Value::Flag(health.k6.map(|_| health.k6_observable));
    "k7_observable" "" Value::Flag(health.k7.map(|_| health.k7_observable));
    "k8_observable" "" Value::Flag(health.k8.map(|_| health.k8_observable));
    "damage_friction" "1" Number(health.damage_friction);
    "damage_backlash" "1" Number(health.damage_backlash);
    "damage_short_a" "1" Number(health.damage_short_a);
    "damage_short_b" "1" Number(health.damage_short_b);
    "damage_short_c" "1" Number(health.damage_short_c);
    "damage_eccentricity" "1" Number(health.damage_eccentricity);
    "damage_gain" "1" Number(health.damage_gain);
    "cost" "1" Number(health.cost);
    "residual_rms_a" "A" Number(health.residual_rms_a);
    "evaluations" "" Count(health.evaluations);
    "operating_h" "h" Number(rul.operating_h);
    "operating_cycles" "cycles" Number(rul.operating_cycles);
    "operating_work_j" "J" Number(rul.operating_work_j);
    "rul_p10_h" "h" Number(rul.rul_p10_h);
    "rul_p50_h" "h" Number(rul.rul_p50_h);
    "rul_p90_h" "h" Number(rul.rul_p90_h);
    "rul_p10_cycles" "cycles" Number(rul.rul_p10_cycles);
    "rul_p50_cycles" "cycles" Number(rul.rul_p50_cycles);
    "rul_p90_cycles" "cycles" Number(rul.rul_p90_cycles);
    "failure_probability" "1" Number(rul.failure_probability);
    "horizon_h" "h" Number(rul.horizon_h);
    "dominant_fault" "" Text(rul.dominant_fault.clone());
    "governed_by" "" Text(rul.governed_by.clone());
    "replaced" "" Text(rul.replaced.clone());
    "rul_reason" "" Text(rul.reason.clone());
    "friction_p10_h" "h" Number(rul.friction_p10_h);
    "friction_p50_h" "h" Number(rul.friction_p50_h);
    "friction_p90_h" "h" Number(rul.friction_p90_h);
    "friction_failure_probability" "1" Number(rul.friction_failure_probability);
    "backlash_p10_h" "h" Number(rul.backlash_p10_h);
    "backlash_p50_h" "h" Number(rul.backlash_p50_h);
    "backlash_p90_h" "h" Number(rul.backlash_p90_h);
    "backlash_failure_probability" "1" Number(rul.backlash_failure_probability);
    "short_a_p10_h" "h" Number(rul.short_a_p10_h);
    "short_a_p50_h" "h" Number(rul.short_a_p50_h);
    "short_a_p90_h" "h" Number(rul.short_a_p90_h);
    "short_a_failure_probability" "1" Number(rul.short_a_failure_probability);
    "short_b_p10_h" "h" Number(rul.short_b_p10_h);
    "short_b_p50_h" "h" Number(rul.short_b_p50_h);
    "short_b_p90_h" "h" Number(rul.short_b_p90_h);
    "short_b_failure_probability" "1" Number(rul.short_b_failure_probability);
    "short_c_p10_h" "h" Number(rul.short_c_p10_h);
    "short_c_p50_h" "h" Number(rul.short_c_p50_h);
    "short_c_p90_h" "h" Number(rul.short_c_p90_h);
    "short_c_failure_probability" "1" Number(rul.short_c_failure_probability);
    "eccentricity_p10_h" "h" Number(rul.eccentricity_p10_h);
    "eccentricity_p50_h" "h" Number(rul.eccentricity_p50_h);
    "eccentricity_p90_h" "h" Number(rul.eccentricity_p90_h);
    "eccentricity_failure_probability" "1" Number(rul.eccentricity_failure_probability);
    "gain_p10_h" "h" Number(rul.gain_p10_h);
    "gain_p50_h" "h" Number(rul.gain_p50_h);
    "gain_p90_h" "h" Number(rul.gain_p90_h);
    "gain_failure_probability" "1" Number(rul.gain_failure_probability);
    "suspects" "" Text(health.suspects.join(","));
    "state_friction" "" Text(health.state_friction.clone());
    "state_backlash" "" Text(health.state_backlash.clone());
    "state_short_a" "" Text(health.state_short_a.clone());
    "state_short_b" "" Text(health.state_short_b.clone());
    "state_short_c" "" Text(health.state_short_c.clone());
    "state_eccentricity" "" Text(health.state_eccentricity.clone());
    "state_gain" "" Text(health.state_gain.clone());
    "hours_of" "" Text(rul.hours_of.clone());
    "serial_number" "" Text(origin.serial_number.to_owned());
    "file" "" Text(origin.file.to_owned());
}

columns! {
    /// One stored sample.
    SAMPLES, pub(super) fn sample_row(window: &Window, n: usize, origin: Origin<'_>), 15:
    "t_ns" "ns, UTC" Time(window.t_start_ns.saturating_add(nanoseconds(window, n)));
    "actuator" "" Text(window.actuator.clone());
    "window" "" Count(window.window);
    "status" "" Text(window.status.clone());
    "time_s" "s" Number(value_at(&window.time_s, n));
    "mode" "" Text(window.mode.clone());
    "setpoint" "rad at the output (position), rad/s at the motor (speed)" Number(value_at(&window.setpoint, n));
    "measured_i_q_a" "A" Number(value_at(&window.measured_i_q_a, n));
    "fitted_i_q_a" "A" Number(value_at(&window.fitted_i_q_a, n));
    "measured_speed_rad_s" "rad/s" Number(value_at(&window.measured_speed_rad_s, n));
    "fitted_speed_rad_s" "rad/s" Number(value_at(&window.fitted_speed_rad_s, n));
    "measured_position_rad" "rad" Number(value_at(&window.measured_position_rad, n));
    "fitted_position_rad" "rad" Number(value_at(&window.fitted_position_rad, n));
    "serial_number" "" Text(origin.serial_number.to_owned());
    "file" "" Text(origin.file.to_owned());
}

columns! {
    /// One sample of a log.
    RAW, pub(super) fn raw_row(actuator: &str, rate: SampleRate, sample: &TimedSample, conditions: &MeasuredConditions, origin: Origin<'_>), 16:
    "t_ns" "ns, UTC" Time(sample.stamp_ns);
    "actuator" "" Text(actuator.to_owned());
    "seq" "" Count(sample.seq);
    "sample_rate_hz" "Hz" Number(Some(rate.hz));
    "i_a_a" "A" Number(Some(sample.sensed.currents[0]));
    "i_b_a" "A" Number(Some(sample.sensed.currents[1]));
    "i_c_a" "A" Number(Some(sample.sensed.currents[2]));
    "motor_counts" "" Value::Signed(sample.sensed.motor_counts);
    "output_counts" "" Value::Signed(sample.sensed.output_counts);
    "mode" "" Text(commanded(sample.sensed.setpoint).0.to_owned());
    "setpoint" "rad at the output (position), rad/s at the motor (speed)" Number(commanded(sample.sensed.setpoint).1);
    "dc_link_v" "V" Number(conditions.dc_link_v);
    "winding_temp_c" "°C" Number(conditions.winding_temp_deg_c);
    "load_torque_nm" "Nm" Number(conditions.load_torque_nm);
    "serial_number" "" Text(origin.serial_number.to_owned());
    "file" "" Text(origin.file.to_owned());
}

/// The columns of the table of a log's samples.
#[must_use]
pub fn raw_heads() -> Vec<Head> {
    let rate = SampleRate {
        hz: 0.0,
        uncertainty: 0.0,
        is_measured: false,
    };
    let sensed = SensedSample {
        seq: 0,
        currents: [0.0; 3],
        motor_counts: 0,
        output_counts: 0,
        setpoint: Setpoint::Idle,
    };
    let sample = TimedSample {
        seq: 0,
        stamp_ns: 0,
        sensed,
    };
    let conditions = MeasuredConditions::default();
    heads(&RAW, &raw_row("", rate, &sample, &conditions, Origin::default()))
}

/// Mode and setpoint; there is none when idle.
fn commanded(setpoint: Setpoint) -> (&'static str, Option<f64>) {
    match setpoint {
        Setpoint::Idle => ("idle", None),
        Setpoint::Position(angle) => ("position", Some(angle)),
        Setpoint::Speed(speed) => ("speed", Some(speed)),
    }
}

/// All stored samples of a window.
pub(super) fn sample_rows(window: &Window, origin: Origin<'_>) -> Vec<Vec<Value>> {
    (0..window.time_s.len())
        .map(|n| sample_row(window, n, origin))
        .collect()
}

fn value_at(values: &[f32], n: usize) -> Option<f64> {
    values
        .get(n)
        .map(|value| f64::from(*value))
        .filter(|value| value.is_finite())
}

/// Time of a sample after the start of its window; whole microseconds, which is what a recorded time of half a second holds.
fn nanoseconds(window: &Window, n: usize) -> u64 {
    // A negative or absurd time saturates.
    1_000 * ((value_at(&window.time_s, n).unwrap_or(0.0) * 1e6).round() as u64).min(u64::from(u32::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_has_its_own_name_and_a_unit_that_fits() {
        for heads in [TableKind::Health.heads(), TableKind::Samples.heads(), raw_heads()] {
            let mut names: Vec<&str> = heads.iter().map(|head| head.name).collect();
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), heads.len());
            for head in heads {
                assert_eq!(
                    head.unit.is_empty(),
                    !matches!(head.kind, Kind::Number | Kind::Time),
                    "{head:?}"
                );
                for (end, unit) in [
                    ("_h", "h"),
                    ("_a", "A"),
                    ("_rad_s", "rad/s"),
                    ("_rad", "rad"),
                    ("_cycles", "cycles"),
                    ("_hz", "Hz"),
                    ("_v", "V"),
                    ("_c", "°C"),
                    ("_nm", "Nm"),
                ] {
                    // Names of faults end like units.
                    let fault = ["damage_", "state_", "short_c"]
                        .iter()
                        .any(|start| head.name.starts_with(start));
                    assert!(fault || !head.name.ends_with(end) || head.unit == unit, "{head:?}");
                }
            }
        }
    }
}

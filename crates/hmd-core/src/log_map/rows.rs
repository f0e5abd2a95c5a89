//! [`RowDecoder`]: rows of a log -> samples and conditions of the built-in dictionary.

use std::sync::Arc;

use ema_models::{ActuatorParams, Real, abc_from_alpha_beta, alpha_beta_from_dq};
use ema_wire::can::Status;
use ema_wire::{ActuatorId, Sample, quantity};
use thiserror::Error;

use super::{Clock, Column, LogMap, Quantity};
use crate::dbc::{Latched, Role, SampleMaker, Unit};

/// Most samples that are counted as missing between two rows: the counter's 16 bits show no more.
const STEP_MAX: f64 = 32_000.0;

/// Largest time, µs: in 2255, far from where whole microseconds get lost in a float.
const TIME_MAX_US: f64 = 9e15;

/// Makes samples of the rows of one log.
#[derive(Clone, Debug)]
pub struct RowDecoder {
    map: Arc<LogMap>,
    columns: Vec<(Column, Unit)>,
    maker: SampleMaker,
    /// Counts of the motor per electrical radian, inverted.
    electrical_rad_per_count: f64,
    /// Counts of the output per count of the motor, of a rigid gear.
    output_per_motor: f64,
    numbering: Option<Numbering>,
    start_us: f64,
    /// Place of the current whose rows are the samples.
    first_current: Option<usize>,
    /// Commands keep their value until they have another.
    commands: Latched,
    /// Conditions, and what was handed out of them last.
    status: Status,
    reported: Status,
    last_row: Vec<f64>,
}

/// Numbers rows by their time.
#[derive(Clone, Copy, Debug)]
struct Numbering {
    period_us: f64,
    last: Option<Numbered>,
}

/// A row that was numbered.
#[derive(Clone, Copy, Debug)]
struct Numbered {
    number: u16,
    time_us: f64,
    /// When its number is due by the even steps of the rows before.
    due_us: f64,
    /// Rows that show these steps.
    rows: u32,
}

impl Numbered {
    /// A row from which even steps begin.
    fn first(number: u16, time_us: f64) -> Self {
        Self {
            number,
            time_us,
            due_us: time_us,
            rows: 1,
        }
    }
}

/// Share of what a row is off its even step by that the next steps follow: they average over ten rows.
const FOLLOWED: f64 = 0.1;

/// Steps from one row to the next after which even steps begin anew: the period is not known to a share of a step for longer.
const STEPS_KNOWN: f64 = 8.0;

/// Longest time before its zero from which a log counts, as a trigger is recorded, µs: a day.
const BEFORE_ZERO_US: f64 = 86.4e9;

/// What a row has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decoded {
    /// Time of the row, UTC, ns; on whole microseconds.
    pub stamp_ns: u64,
    /// The conditions, where the row changed them.
    pub status: Option<Status>,
    /// The sample.
    pub sample: Sample,
}

/// Why a row is no sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("expected {}, found {}", self.expected(), self.found())]
pub enum RowFault {
    /// A column has no number.
    NoNumber(Quantity),
    /// The time is before 1970 or after 2255.
    NoTime,
    /// The time goes back, or stands still.
    NotLater,
}

impl RowFault {
    /// What is expected of the column.
    #[must_use]
    pub fn expected(self) -> &'static str {
        match self {
            Self::NoNumber(_) => "a number",
            Self::NoTime => "a time from 1970 to 2255",
            Self::NotLater => "a time later than the row before's",
        }
    }

    /// What is there.
    #[must_use]
    pub fn found(self) -> &'static str {
        match self {
            Self::NoNumber(_) => "none",
            Self::NoTime => "another",
            Self::NotLater => "an earlier one or the same",
        }
    }

    /// The column it is in.
    #[must_use]
    pub fn quantity(self) -> Quantity {
        match self {
            Self::NoNumber(quantity) => quantity,
            Self::NoTime | Self::NotLater => Quantity::Time,
        }
    }
}

/// Electrical angle for each count of the motor's angle, rad.
pub(super) fn electrical_rad_per_count(params: &ActuatorParams) -> f64 {
    core::f64::consts::TAU * params.motor.pole_pairs / params.sensors.motor_counts_per_rev
}

impl RowDecoder {
    /// For one actuator; `columns` are those of the map and the time, each with the conversion of its numbers, `start_us` is added to the
    /// time, UTC, µs, and `first_times` are those of the first rows in the log's own numbers: they show the period where nothing counts
    /// samples.
    #[must_use]
    pub fn new(
        actuator: ActuatorId,
        params: &ActuatorParams,
        map: Arc<LogMap>,
        columns: Vec<(Column, Unit)>,
        start_us: f64,
        first_times: &[f64],
    ) -> Self {
        let of = |quantity: Quantity| {
            let mut columns = columns.iter();
            columns.find(move |(column, _)| column.quantity == quantity)
        };
        let wraps_after = [Role::MotorPosition, Role::OutputPosition].map(|role| {
            let (column, unit) = of(Quantity::Of(role))?;
            Some(column.wraps_after? * unit.scale.abs())
        });
        let time = of(Quantity::Time).map_or(Unit::SAME, |(_, unit)| *unit);
        let time_scale = time.scale;
        let times_us = first_times
            .iter()
            .map(|&time_of_log| time.to_internal(time_of_log) + start_us);
        let start_us = start_us + whole_seconds_before_zero(times_us);
        let roles = map.columns().iter().filter_map(|column| match column.quantity {
            Quantity::Of(role) => Some(role),
            Quantity::Time | Quantity::Counter | Quantity::CurrentD | Quantity::CurrentQ => None,
        });
        let sensors = &params.sensors;
        let maker = SampleMaker::new(actuator, roles, map.modes, wraps_after).with_any_zero(sensors.output_lsb());
        let numbering = (!map.has(Quantity::Counter)).then(|| Numbering {
            period_us: period(first_times).map_or(1e6 / sensors.sample_rate, |period| period * time_scale.abs()),
            last: None,
        });
        let status = Status {
            dc_link_dv: 0,
            winding_temp_dc: Status::NO_TEMPERATURE,
            load_torque_dnm: None,
            fault_flags: 0,
            seq8: 0,
        };
        Self {
            maker,
            electrical_rad_per_count: electrical_rad_per_count(params),
            output_per_motor: sensors.output_counts_per_rev
                / sensors.motor_counts_per_rev
                / params.transmission.gear_ratio,
            numbering,
            start_us,
            first_current: columns.iter().position(|(column, _)| column.quantity.is_current()),
            commands: Latched::default(),
            status,
            reported: status,
            last_row: Vec::with_capacity(columns.len()),
            columns,
            map,
        }
    }

    /// Takes a row: a number for each column of the map, NaN where it has none. `None` of one that is no sample: it lacks the first
    /// current, and only what holds its value is taken of it; or it is the row before, written twice.
    ///
    /// # Errors
    /// [`RowFault`]; the row is lost.
    pub fn push(&mut self, row: &[f64]) -> Result<Option<Decoded>, RowFault> {
        let mut latched = self.commands;
        let (mut time_us, mut counter, mut rotor) = (0.0, 0_u16, [0.0; 2]);
        let mut fault = None;
        for ((column, unit), &number) in self.columns.iter().zip(row) {
            let value = unit.to_internal(number);
            if !value.is_finite() {
                if !column.quantity.is_held() {
                    fault.get_or_insert(RowFault::NoNumber(column.quantity));
                }
                continue;
            }
            match column.quantity {
                Quantity::Time => time_us = value,
                Quantity::Counter => counter = value.round().rem_euclid(65_536.0) as u16,
                Quantity::CurrentD => rotor[0] = value,
                Quantity::CurrentQ => rotor[1] = value,
                Quantity::Of(Role::DcLink) => self.status.dc_link_dv = quantity::dc_link_dv(value),
                Quantity::Of(Role::WindingTemp) => self.status.winding_temp_dc = quantity::winding_temp_dc(value),
                Quantity::Of(Role::LoadTorque) => {
                    self.status.load_torque_dnm = Some(quantity::load_torque_dnm(value));
                }
                Quantity::Of(role) => {
                    latched.set(role, value);
                    if column.quantity.is_command() {
                        self.commands.set(role, value);
                    }
                }
            }
        }
        if self.first_current.is_some_and(|place| !row[place].is_finite()) || self.is_repeated(row) {
            return Ok(None);
        }
        if let Some(fault) = fault {
            return Err(fault);
        }
        let utc_us = (time_us + self.start_us).round();
        if !(0.0..=TIME_MAX_US).contains(&utc_us) {
            return Err(RowFault::NoTime);
        }
        if self.map.clock == Clock::Device && !self.map.has(Quantity::Of(Role::Time)) {
            latched.set(Role::Time, time_us);
        }
        // The angle goes on where its counter begins again, which may be anywhere in a turn.
        let motor = self.maker.continue_motor(latched.value(Role::MotorPosition));
        if self.map.has(Quantity::CurrentQ) {
            let theta_e = (motor * self.electrical_rad_per_count).rem_euclid(core::f64::consts::TAU);
            let [a, b, c] = abc_from_alpha_beta(alpha_beta_from_dq(rotor, theta_e.sin_cos_poly()));
            latched.set(Role::CurrentA, a);
            latched.set(Role::CurrentB, b);
            latched.set(Role::CurrentC, c);
        }
        let number = match &mut self.numbering {
            Some(numbering) => numbering.next(time_us).ok_or(RowFault::NotLater)?,
            None => counter,
        };
        let mut sample = self.maker.sample(&latched, number);
        if !self.map.has(Quantity::Of(Role::OutputPosition)) {
            let counts = self.maker.motor_counts() * self.output_per_motor;
            sample.output_counts = quantity::wrap_s24(counts.floor() as i64);
        }
        let before = std::mem::replace(&mut self.reported, self.status);
        Ok(Some(Decoded {
            stamp_ns: utc_us as u64 * 1000,
            status: (self.status != before).then_some(self.status),
            sample,
        }))
    }

    /// Whether a row is the one before, which it replaces.
    fn is_repeated(&mut self, row: &[f64]) -> bool {
        let mut values = self.last_row.iter().zip(row);
        if self.last_row.len() == row.len() && values.all(|(last, value)| last.to_bits() == value.to_bits()) {
            return true;
        }
        self.last_row.clear();
        self.last_row.extend_from_slice(row);
        false
    }
}

impl Numbering {
    /// The number of a row; `None` where its time is not later than the one before.
    fn next(&mut self, time_us: f64) -> Option<u16> {
        let Some(last) = self.last else {
            self.last = Some(Numbered::first(0, time_us));
            return Some(0);
        };
        if time_us <= last.time_us {
            // After a step back in time a number is left out, so that no window goes on over it.
            self.last = Some(Numbered::first(last.number.wrapping_add(2), time_us));
            return None;
        }
        // A row is late or early by itself: what counts is its distance from even steps, not from the row before.
        let steps = ((time_us - last.due_us) / self.period_us).round().clamp(1.0, STEP_MAX);
        let number = last.number.wrapping_add(steps as u16);
        let rows = last.rows.saturating_add(1);
        let due_us = last.due_us + steps * self.period_us;
        let followed = FOLLOWED.max(1.0 / f64::from(rows));
        self.last = Some(if steps > STEPS_KNOWN {
            Numbered::first(number, time_us)
        } else {
            Numbered {
                number,
                time_us,
                due_us: due_us + followed * (time_us - due_us),
                rows,
            }
        });
        Some(number)
    }
}

/// Whole seconds, µs, by which times before zero are moved, so that the earliest is not; 0 of times that are no seconds since a trigger.
fn whole_seconds_before_zero(times_us: impl Iterator<Item = f64>) -> f64 {
    let earliest = times_us.fold(0.0, f64::min);
    if earliest >= -BEFORE_ZERO_US {
        (-earliest * 1e-6).ceil() * 1e6
    } else {
        0.0
    }
}

/// The mean distance of times; `None` of fewer than two that rise.
///
/// Of times on a grid no single step is that distance. Pauses, losses and times that are late by most of a step are left out, each with
/// the step that it shortens: the limits lie evenly about the median.
fn period(times: &[f64]) -> Option<f64> {
    const LIMITS: [f64; 2] = [0.25, 1.75];
    let steps = times.windows(2).map(|two| (two[1] - two[0]).abs());
    let mut steps: Vec<f64> = steps.filter(|step| step.is_finite() && *step > 0.0).collect();
    steps.sort_unstable_by(f64::total_cmp);
    let median = *steps.get(steps.len() / 2)?;
    steps.retain(|step| (LIMITS[0]..=LIMITS[1]).contains(&(step / median)));
    Some(steps.iter().sum::<f64>() / steps.len() as f64)
}

#[cfg(test)]
mod tests {
    use ema_wire::Mode;

    use super::*;
    use crate::dbc::ModeCodes;
    use crate::log_map::ModeNames;

    /// A decoder of these quantities, counts and SI units, the motor's angle beginning again after so many counts.
    fn decoder(quantities: &[Quantity], wraps_after: Option<f64>) -> RowDecoder {
        let column = |quantity: &Quantity| {
            let is_motor = *quantity == Quantity::Of(Role::MotorPosition);
            Column {
                wraps_after: wraps_after.filter(|_| is_motor),
                ..Column::plain(*quantity, quantity.key())
            }
        };
        let columns: Vec<Column> = quantities.iter().map(column).collect();
        let map = LogMap::new(
            columns.clone(),
            Clock::Device,
            ModeCodes::default(),
            ModeNames::default(),
        );
        let map = Arc::new(map.expect("a whole map"));
        let columns = columns.into_iter().map(|column| (column, Unit::SAME)).collect();
        let actuator = ActuatorId::new(0).expect("a number");
        RowDecoder::new(actuator, &ActuatorParams::bench(), map, columns, 0.0, &[0.0, 500.0])
    }

    const DQ: [Quantity; 4] = [
        Quantity::Time,
        Quantity::CurrentQ,
        Quantity::Of(Role::MotorPosition),
        Quantity::Of(Role::OutputPosition),
    ];

    fn sample(decoder: &mut RowDecoder, row: &[f64]) -> Sample {
        let decoded = decoder.push(row).expect("a row");
        decoded.expect("a sample").sample
    }

    #[test]
    fn the_electrical_angle_goes_on_where_the_counter_begins_again_within_a_turn() {
        const RANGE: f64 = 50_000.0;
        let (mut whole, mut wrapped) = (decoder(&DQ[..3], None), decoder(&DQ[..3], Some(RANGE)));
        for n in 0..200 {
            let (time, counts) = (f64::from(n) * 500.0, 45_000.0 + 1234.0 * f64::from(n));
            let found = sample(&mut wrapped, &[time, 3.0, counts.rem_euclid(RANGE)]);
            assert_eq!(found, sample(&mut whole, &[time, 3.0, counts]), "{n}");
        }
    }

    const COMMANDED: [Quantity; 6] = [
        Quantity::Time,
        Quantity::CurrentQ,
        Quantity::Of(Role::MotorPosition),
        Quantity::Of(Role::CommandPosition),
        Quantity::MODE,
        Quantity::Of(Role::DcLink),
    ];

    #[test]
    fn commands_hold_and_are_none_before_their_first_value() {
        const NONE: f64 = f64::NAN;
        let mut decoder = decoder(&COMMANDED, None);
        let rows = [
            ([0.0, 1.0, 0.0, NONE, NONE, NONE], Mode::Idle, 0),
            ([500.0, 1.0, 0.0, NONE, 1.0, NONE], Mode::Idle, 0),
            ([1000.0, 1.0, 0.0, 0.25, NONE, NONE], Mode::Position, 250_000),
            ([1500.0, 1.0, 0.0, NONE, NONE, NONE], Mode::Position, 250_000),
            ([2000.0, 1.0, 0.0, NONE, 0.0, NONE], Mode::Idle, 0),
        ];
        for (row, mode, setpoint) in rows {
            let sample = sample(&mut decoder, &row);
            assert_eq!((sample.mode, sample.setpoint), (mode, setpoint), "{row:?}");
        }
        // A row without the first current is no sample; what holds is taken of it, and reported with the next one.
        let other = decoder.push(&[2200.0, NONE, NONE, 0.5, 1.0, 48.0]);
        assert_eq!(other, Ok(None));
        let next = decoder.push(&[2500.0, 1.0, 0.0, NONE, NONE, NONE]);
        let next = next.expect("a row").expect("a sample");
        assert_eq!((next.sample.mode, next.sample.setpoint), (Mode::Position, 500_000));
        assert_eq!(next.status.map(|status| status.dc_link_dv), Some(480));
        assert_eq!(next.sample.seq, 5);
        let no_angle = decoder.push(&[3000.0, 1.0, NONE, NONE, NONE, NONE]);
        assert_eq!(no_angle, Err(RowFault::NoNumber(Quantity::Of(Role::MotorPosition))));
    }

    #[test]
    fn a_row_that_is_written_twice_is_one_sample() {
        let mut decoder = decoder(&DQ, None);
        let row = |n: u16, current: f64| [500.0 * f64::from(n), current, 0.0, 0.0];
        assert_eq!(sample(&mut decoder, &row(0, 1.0)).seq, 0);
        assert_eq!(sample(&mut decoder, &row(1, 1.0)).seq, 1);
        assert_eq!(decoder.push(&row(1, 1.0)), Ok(None));
        assert_eq!(sample(&mut decoder, &row(2, 1.0)).seq, 2);
        // Another row of the same time: nobody knows which is right, and no window goes on over it.
        assert_eq!(decoder.push(&row(2, 2.0)), Err(RowFault::NotLater));
        assert_eq!(sample(&mut decoder, &row(3, 1.0)).seq, 5);
    }

    #[test]
    fn rows_that_are_early_and_late_keep_their_numbers() {
        let numbered = |off: &dyn Fn(u32) -> f64, lost: &[u32]| {
            let mut numbering = Numbering {
                period_us: 502.0,
                last: None,
            };
            let rows = (0..3000_u32).filter(|n| !lost.contains(n));
            rows.map(|n| numbering.next(500.0 * (f64::from(n) + off(n))).expect("a later time"))
                .map(u32::from)
                .collect::<Vec<u32>>()
        };
        // Evenly spread over ±0.3 periods, the first row latest.
        let spread = |n: u32| 0.3 - 0.6 * (f64::from(n) * 0.618_034).fract();
        assert_eq!(numbered(&spread, &[]), (0..3000).collect::<Vec<u32>>());
        let lost = [400, 401, 900];
        let expected: Vec<u32> = (0..3000).filter(|n| !lost.contains(n)).collect();
        assert_eq!(numbered(&spread, &lost), expected);
        // After a pause the steps begin anew.
        let pause: Vec<u32> = (1000..1700).collect();
        let found = numbered(&|_| 0.0, &pause);
        assert_eq!(found.last().map(|last| last - found[1000]), Some(1299));
    }

    #[test]
    fn times_before_a_trigger_count_from_a_whole_second_before_them() {
        let decoder = |first: f64| {
            let mut of = decoder(&DQ, None);
            let columns = of.columns.clone();
            let actuator = ActuatorId::new(0).expect("a number");
            of = RowDecoder::new(
                actuator,
                &ActuatorParams::bench(),
                of.map,
                columns,
                0.0,
                &[first, first + 500.0],
            );
            of
        };
        let stamp = |first: f64, time: f64| {
            let decoded = decoder(first).push(&[time, 1.0, 0.0, 0.0]);
            decoded.map(|decoded| decoded.expect("a sample").stamp_ns)
        };
        assert_eq!(stamp(-2.0e6, -2.0e6), Ok(0));
        assert_eq!(stamp(-2.0e6, 1.0e6), Ok(3_000_000_000));
        assert_eq!(stamp(-10.0, -10.0), Ok(999_990_000));
        assert_eq!(stamp(0.0, 0.0), Ok(0));
        assert_eq!(stamp(-1e15, -1e15), Err(RowFault::NoTime));
    }

    #[test]
    fn the_period_is_the_mean_distance() {
        let near = |times: &[f64], expected: f64| {
            let found = period(times).expect("steps");
            assert!((found - expected).abs() < 0.02 * expected, "{found}, {expected}");
        };
        // 400 Hz in whole milliseconds: steps of 2 and 3.
        let of_ms: Vec<f64> = (0..64).map(|n| (f64::from(n) * 2.5).floor()).collect();
        near(&of_ms, 2.5);
        // 600 Hz on a grid of 1 ms: mostly steps of 2 ms, some of 1.
        let of_grid: Vec<f64> = (0..64).map(|n| (f64::from(n) / 0.6).floor()).collect();
        near(&of_grid, 1.0 / 0.6);
        // Lost rows, a pause, and stamps that are late by 0.9 of a step.
        let mut time = 0.0;
        let late: Vec<f64> = (0..64)
            .map(|n| {
                time += match n {
                    20 => 100.0,
                    30 | 40 => 2.0,
                    _ => 1.0,
                };
                if n % 8 == 3 { time + 0.9 } else { time }
            })
            .collect();
        near(&late, 1.0);
        assert_eq!(period(&[1.0]), None);
    }
}

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
    status: Status,
}

/// Numbers rows by their time.
#[derive(Clone, Copy, Debug)]
struct Numbering {
    period_us: f64,
    last: Option<(u16, f64)>,
}

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
            Self::NoNumber(_) => "a number (resample = true in [map] takes signals of several rates)",
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
        let time_scale = of(Quantity::Time).map_or(Unit::SAME, |(_, unit)| *unit).scale;
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
        Self {
            maker,
            electrical_rad_per_count: electrical_rad_per_count(params),
            output_per_motor: sensors.output_counts_per_rev
                / sensors.motor_counts_per_rev
                / params.transmission.gear_ratio,
            numbering,
            start_us,
            status: Status {
                dc_link_dv: 0,
                winding_temp_dc: Status::NO_TEMPERATURE,
                load_torque_dnm: None,
                fault_flags: 0,
                seq8: 0,
            },
            columns,
            map,
        }
    }

    /// Takes a row: a number for each column of the map, NaN where it has none.
    ///
    /// # Errors
    /// [`RowFault`]; the row is lost.
    pub fn push(&mut self, row: &[f64]) -> Result<Decoded, RowFault> {
        let mut latched = Latched::default();
        let (mut time_us, mut counter, mut rotor) = (0.0, 0_u16, [0.0; 2]);
        let before = self.status;
        for ((column, unit), &number) in self.columns.iter().zip(row) {
            let value = unit.to_internal(number);
            if !value.is_finite() {
                if column.quantity.is_sampled() {
                    return Err(RowFault::NoNumber(column.quantity));
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
                Quantity::Of(role) => latched.set(role, value),
            }
        }
        let utc_us = (time_us + self.start_us).round();
        if !(0.0..=TIME_MAX_US).contains(&utc_us) {
            return Err(RowFault::NoTime);
        }
        if self.map.clock == Clock::Device && !self.map.has(Quantity::Of(Role::Time)) {
            latched.set(Role::Time, time_us);
        }
        let motor = latched.value(Role::MotorPosition);
        if self.map.has(Quantity::CurrentQ) {
            let sin_cos = (motor * self.electrical_rad_per_count).rem_euclid(core::f64::consts::TAU);
            let [a, b, c] = abc_from_alpha_beta(alpha_beta_from_dq(rotor, sin_cos.sin_cos_poly()));
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
        self.status.seq8 = 0;
        Ok(Decoded {
            stamp_ns: utc_us as u64 * 1000,
            status: (self.status != before).then_some(self.status),
            sample,
        })
    }
}

impl Numbering {
    /// The number of a row; `None` where its time is not later than the one before.
    fn next(&mut self, time_us: f64) -> Option<u16> {
        let Some((number, last_us)) = self.last else {
            self.last = Some((0, time_us));
            return Some(0);
        };
        let elapsed_us = time_us - last_us;
        // After a step back in time a number is left out, so that no window goes on over it.
        let steps = if elapsed_us > 0.0 {
            (elapsed_us / self.period_us).round().clamp(1.0, STEP_MAX)
        } else {
            2.0
        };
        let number = number.wrapping_add(steps as u16);
        self.last = Some((number, time_us));
        (elapsed_us > 0.0).then_some(number)
    }
}

/// The usual distance of times, their median; `None` of fewer than two that rise.
fn period(times: &[f64]) -> Option<f64> {
    let steps = times.windows(2).map(|two| (two[1] - two[0]).abs());
    let mut steps: Vec<f64> = steps.filter(|step| step.is_finite() && *step > 0.0).collect();
    steps.sort_unstable_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied()
}

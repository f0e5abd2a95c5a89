//! The life of one actuator: how much it was used, how worn it is, and what is left. No clock; files only in `state`
//! (lives that outlast the daemon) and `events` (maintenance).

mod book;
mod functional;
mod maintenance;
mod urgency;

use ema_models::{FAULT_COUNT, FaultVector};
use serde::{Deserialize, Serialize};

use crate::config::{Config, HoursOf};
use crate::demux::WindowJob;
use crate::functional_check::Trial;
use crate::health::{FAULTS, Health, HealthDecision, HealthState, Judgement, LevelsError};
use crate::rul::{Forecast, Odometer, Prognosis};
use ema_identify::Fit;
use urgency::Urgency;

pub use book::Lives;
pub use functional::Governs;
pub use maintenance::{Event, EventKind, Events};

/// Everything that is remembered of an actuator from window to window.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Life {
    /// Time of the maintenance event with which it began, UTC ns; 0 without one.
    begun_ns: u64,
    /// Maintenance events up to then that are followed, counted: one that was told of later may lie earlier, because a
    /// clock was wrong. Files of version 1 had no count.
    #[serde(default)]
    events_followed: Option<u64>,
    /// Serial number of the unit whose life this is.
    serial_number: Option<String>,
    health: Health,
    prognosis: Prognosis,
    urgency: Urgency,
    used: Odometer,
    /// Actuations whose work is known, in `used.work_j`; the others are taken to be like them.
    measured: Measured,
    last: Option<Last>,
    /// The newest fault vector.
    fault: Option<[f64; FAULT_COUNT]>,
    /// The last trial of the function; files of version 1 had none.
    #[serde(default)]
    tried: Option<functional::Tried>,
}

/// What a window shows of an actuator.
#[derive(Clone, Copy)]
pub struct Shown<'a> {
    /// Its damage, if it was judged.
    pub judgement: Option<&'a Judgement>,
    /// Its fault vector, if it was judged.
    pub fault: Option<&'a FaultVector>,
    /// Currents and speeds, for the work done; empty where it was not identified.
    pub fit: &'a Fit,
    /// The requirement that a fault vector makes the actuator miss; `None` where nothing is required.
    pub shortfall: Option<&'a Trial<'a>>,
}

/// Work that was measured.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Measured {
    work_j: f64,
    cycles: f64,
}

/// The window before.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Last {
    t_start_ns: u64,
    window: u64,
    operating_s: f64,
}

/// What is said of a life after a window.
#[derive(Clone, Debug)]
pub struct LifeDecision {
    /// State and faults by damage alone.
    pub health: HealthDecision,
    /// The worse of health by damage and by what is left.
    pub state: HealthState,
    /// What is left.
    pub forecast: Forecast,
    /// What ends the life.
    pub governs: Governs,
    /// Use so far.
    pub used: Odometer,
}

impl Life {
    /// Of a new part.
    ///
    /// # Errors
    /// Levels that contradict each other.
    pub fn new(config: &Config, serial_number: Option<String>) -> Result<Self, LevelsError> {
        let levels = *config.health().levels();
        Ok(Self {
            begun_ns: 0,
            events_followed: None,
            serial_number,
            health: Health::new(levels)?,
            prognosis: Prognosis::new(levels.map(|l| l.end_of_life)),
            urgency: Urgency::default(),
            used: Odometer::default(),
            measured: Measured::default(),
            last: None,
            fault: None,
            tried: None,
        })
    }

    /// Whether it could have come about: a file may say anything.
    #[must_use]
    pub fn is_possible(&self) -> bool {
        let used = [self.used.hours, self.used.cycles, self.used.work_j];
        used.iter().all(|used| *used >= 0.0)
            && i64::try_from(self.begun_ns).is_ok()
            && self.health.is_possible()
            && self.prognosis.is_possible()
            && self.urgency.is_possible()
    }

    /// A life that was kept goes on under a configuration, after a pause that counts for nothing; a unit with another
    /// serial number begins a new one.
    ///
    /// # Errors
    /// Levels that contradict each other.
    pub fn resumed(self, config: &Config, serial_number: Option<String>) -> Result<Self, LevelsError> {
        let new = Self::new(config, serial_number)?;
        if self.serial_number != new.serial_number {
            return Ok(new);
        }
        Ok(Self {
            health: self.health.with_rules_of(&new.health),
            // The specification may be another one.
            tried: None,
            prognosis: self.prognosis.with_end_of_life(new.prognosis.end_of_life()),
            // Frames are counted from the start of the daemon; elapsed hours go on.
            last: self.last.map(|last| Last {
                operating_s: 0.0,
                window: 0,
                ..last
            }),
            ..self
        })
    }

    /// Takes a window and what it shows.
    pub fn update(&mut self, job: &WindowJob, shown: &Shown<'_>, config: &Config) -> LifeDecision {
        self.count(job, shown.fit, config.rul().hours);
        let estimates: [Option<(f64, f64)>; FAULTS] =
            std::array::from_fn(|fault| shown.judgement.and_then(|judgement| judgement.of(fault)));
        self.prognosis.update(self.used, &estimates);
        let mut forecast = self.prognosis.forecast(config.rul().horizon_h);
        self.fault = shown.fault.map(|fault| fault.to_array()).or(self.fault);
        let governs = match (shown.shortfall, self.fault) {
            (Some(shortfall), Some(fault)) => {
                let fault = FaultVector::from_array(fault);
                functional::bring_forward(&mut forecast, &self.prognosis, &fault, shortfall, &mut self.tried)
            }
            _ => Governs::Damage,
        };
        let health = self.health.update(job.window.number, shown.judgement);
        let left_h = forecast.actuator.ok().map(|life| life.hours.p10);
        // The function is missed by all faults together.
        let ends_by = forecast.dominant.filter(|_| governs == Governs::Damage);
        let urgent = self
            .urgency
            .update(left_h, config.rul(), self.health.persistence(ends_by));
        LifeDecision {
            state: health.state.max(urgent),
            health,
            forecast,
            governs,
            used: self.used,
        }
    }

    /// Windows in a row that ask for a worse state by damage.
    pub(crate) fn pending(&self) -> u32 {
        self.health.pending()
    }

    /// Counts hours, cycles and work.
    fn count(&mut self, job: &WindowJob, fit: &Fit, hours_of: HoursOf) {
        let now = Last {
            t_start_ns: job.window.t_start_ns,
            window: job.window.number,
            operating_s: job.operating_s,
        };
        let hours = match (hours_of, self.last) {
            // A source that began anew counts from 0.
            (HoursOf::Operating, Some(last)) if now.operating_s >= last.operating_s => {
                (now.operating_s - last.operating_s) / 3600.0
            }
            (HoursOf::Operating, _) => now.operating_s / 3600.0,
            (HoursOf::Elapsed, Some(last)) => now.t_start_ns.saturating_sub(last.t_start_ns) as f64 / 3600e9,
            (HoursOf::Elapsed, None) => 0.0,
        };
        // Windows that were dropped for want of time were actuations too.
        let cycles = match self.last {
            Some(last) if now.window > last.window => (now.window - last.window) as f64,
            _ => 1.0,
        };
        let mut unmeasured = cycles;
        let mut work_j = 0.0;
        if let Some(measured) = work_j_of(job, fit) {
            self.measured.work_j += measured;
            self.measured.cycles += 1.0;
            unmeasured -= 1.0;
            work_j = measured;
        }
        if self.measured.cycles > 0.0 {
            work_j += unmeasured * self.measured.work_j / self.measured.cycles;
        }
        self.used = Odometer {
            hours: self.used.hours + hours,
            cycles: self.used.cycles + cycles,
            work_j: self.used.work_j + work_j,
        };
        self.last = Some(now);
    }
}

/// Work of the motor in a window, `Σ |k_t i_q ω| Δt`, J; `None` where the window was not identified.
fn work_j_of(job: &WindowJob, fit: &Fit) -> Option<f64> {
    if fit.i_q_measured.is_empty() {
        return None;
    }
    // Torque per ampere of i_q of three phases.
    let k_t = 1.5 * job.params.motor.k;
    let power = fit
        .i_q_measured
        .iter()
        .zip(&fit.omega_measured)
        .map(|(i_q, omega)| f64::from((i_q * omega).abs()));
    Some(k_t * power.sum::<f64>() / job.params.sensors.sample_rate).filter(|work| work.is_finite())
}

#[cfg(test)]
mod tests;

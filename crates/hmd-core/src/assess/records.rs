//! The records of an assessed window.

use std::collections::BTreeSet;

use ema_models::{FaultId, Setpoint};

use crate::config::RulConfig;
use crate::deadline::TimeLimit;
use crate::health::{HealthDecision, HealthState};
use crate::history::UnitAssessment;
use crate::outbox::WindowJob;
use crate::record::{self, WindowStatus};
use crate::rul::RemainingLife;
use crate::sensor_checks::Suspect;
use crate::sensor_health::{SENSOR_QUANTITY_COUNT, SensorState};
use ema_identify::{Estimate, Fit};

fn largest_fault(decision: &HealthDecision, estimate: Option<&Estimate>) -> String {
    let Some(estimate) = estimate else { return String::new() };
    let damage = |fault: &FaultId| estimate.fault.damage_of(*fault);
    let largest = decision.faults.iter().max_by(|a, b| damage(a).total_cmp(&damage(b)));
    largest.map(|fault| fault.name().to_owned()).unwrap_or_default()
}

pub(super) fn health_record(
    job: &WindowJob,
    status: WindowStatus,
    reason: &str,
    estimate: Option<&Estimate>,
    shown: [Option<f64>; FaultId::COUNT],
    assessment: &UnitAssessment,
    suspects: &[Suspect],
) -> record::Health {
    let decision = &assessment.health;
    let mut health = record::Health {
        actuator: job.actuator.name.clone(),
        window: job.window.number,
        t_start_ns: job.window.t_start_ns,
        status: status.name().to_owned(),
        reason: reason.to_owned(),
        health: assessment.state.to_string(),
        cost: estimate.map(|e| e.cost),
        residual_rms_a: estimate.map(|e| e.residual_rms_a),
        evaluations: estimate.map_or(0, |e| e.evaluations),
        suspects: names_of(suspects),
        ..record::Health::default()
    };
    // A fault vector that does not explain the data is no estimate.
    if let Some(estimate) = estimate.filter(|estimate| !estimate.is_unmodelled()) {
        health.set_estimate(Some(&record::Estimate {
            k: estimate.fault.to_array(),
            sigma: estimate.sigma,
            observable: estimate.observable,
        }));
        health.set_damage(shown);
    }
    health.set_states(&decision.states);
    // An invalid window is never counted as a fault: it lists none, and the state stays what it was.
    if status != WindowStatus::Unmodelled && estimate.is_some() && decision.state > HealthState::Nominal {
        health.set_faults(&decision.faults);
    }
    health
}

/// The names of the suspects, each once.
fn names_of(suspects: &[Suspect]) -> Vec<String> {
    let once: BTreeSet<Suspect> = suspects.iter().copied().collect();
    once.into_iter().map(|suspect| suspect.name().to_owned()).collect()
}

pub(super) fn sensors_record(job: &WindowJob, states: &[SensorState; SENSOR_QUANTITY_COUNT]) -> record::Sensors {
    let mut sensors = record::Sensors {
        actuator: job.actuator.name.clone(),
        window: job.window.number,
        t_start_ns: job.window.t_start_ns,
        ..record::Sensors::default()
    };
    sensors.set_states(states);
    sensors
}

pub(super) fn shortened_record(
    job: &WindowJob,
    limit: &TimeLimit<'_>,
    estimate: Option<&Estimate>,
) -> record::Shortened {
    let mut shortened = record::Shortened {
        actuator: job.actuator.name.clone(),
        window: job.window.number,
        t_start_ns: job.window.t_start_ns,
        deadline_ms: limit.deadline_ms,
        evaluations: estimate.map_or(0, |estimate| estimate.evaluations),
        ..record::Shortened::default()
    };
    shortened.set_grants(&limit.effort.short_grants());
    shortened
}

pub(super) fn rul_record(
    job: &WindowJob,
    estimate: Option<&Estimate>,
    assessment: &UnitAssessment,
    config: &RulConfig,
) -> record::Rul {
    let forecast = &assessment.forecast;
    let mut rul = record::Rul {
        actuator: job.actuator.name.clone(),
        window: job.window.number,
        t_start_ns: job.window.t_start_ns,
        operating_h: Some(assessment.used.hours),
        operating_cycles: Some(assessment.used.cycles),
        operating_work_j: Some(assessment.used.work_j),
        horizon_h: Some(config.horizon_h),
        hours_of: config.hours.name().to_owned(),
        dominant_fault: match forecast.dominant {
            Some(fault) => fault.name().to_owned(),
            None => largest_fault(&assessment.health, estimate),
        },
        replaced: assessment.replaced.clone(),
        ..record::Rul::default()
    };
    match &forecast.actuator {
        Ok(RemainingLife {
            hours,
            cycles,
            fails_within_horizon,
        }) => {
            (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(hours.p10), Some(hours.p50), Some(hours.p90));
            (rul.rul_p10_cycles, rul.rul_p50_cycles, rul.rul_p90_cycles) =
                (cycles.map(|c| c.p10), cycles.map(|c| c.p50), cycles.map(|c| c.p90));
            rul.failure_probability = Some(*fails_within_horizon);
            rul.governed_by = assessment.limiting_criterion.name().to_owned();
        }
        Err(none) => rul.reason = none.to_string(),
    }
    rul.set_faults(forecast.faults.map(|remaining| {
        let remaining = remaining.ok()?;
        Some((
            [remaining.hours.p10, remaining.hours.p50, remaining.hours.p90],
            remaining.fails_within_horizon,
        ))
    }));
    rul
}

pub(super) fn window_record(job: &WindowJob, status: WindowStatus, reason: &str, fit: Fit) -> record::Window {
    let (window, rate) = (&job.window, job.params.sensors.sample_rate);
    let value = |setpoint: Setpoint| match setpoint {
        Setpoint::Idle => 0.0,
        Setpoint::Position(x) | Setpoint::Speed(x) => x,
    };
    let setpoints: Vec<f64> = window.samples.iter().map(|s| value(s.setpoint)).collect();
    // A sample that was filled in is in no comparison, hence in no array.
    // The curves may be those of another estimate than the one that refused counts last.
    let stored: Vec<usize> = if fit.samples.is_empty() {
        (0..window.samples.len())
            .filter(|n| !window.filled.contains(n))
            .collect()
    } else {
        fit.samples
    };
    let after_trigger = window.samples.get(window.trigger).map(|s| s.setpoint);
    let travel = window
        .samples
        .first()
        .zip(window.samples.last())
        .map(|(first, last)| (last.output_counts - first.output_counts) as f64 * job.params.sensors.output_lsb());
    let peak = |values: &[f32]| values.iter().map(|v| f64::from(v.abs())).reduce(f64::max);
    record::Window {
        actuator: job.actuator.name.clone(),
        window: window.number,
        t_start_ns: window.t_start_ns,
        duration_s: window.samples.len().saturating_sub(1) as f64 / rate,
        status: status.name().to_owned(),
        reason: reason.to_owned(),
        // The grid has places for missing samples too, which are filled.
        samples: (window.samples.len() as u64).saturating_sub(window.lost),
        samples_expected: window.expected as u64,
        samples_lost: window.lost,
        sample_rate_hz: rate,
        mode: match after_trigger {
            Some(Setpoint::Position(_)) => "position",
            Some(Setpoint::Speed(_)) => "speed",
            Some(Setpoint::Idle) | None => "idle",
        }
        .to_owned(),
        setpoint_start: setpoints.first().copied(),
        setpoint_end: setpoints.last().copied(),
        setpoint_min: setpoints.iter().copied().reduce(f64::min),
        setpoint_max: setpoints.iter().copied().reduce(f64::max),
        travel_rad: travel,
        peak_speed_rad_s: peak(&fit.omega_measured),
        peak_i_q_a: peak(&fit.i_q_measured),
        dc_link_v: job.conditions.dc_link_v,
        winding_temp_c: job.conditions.winding_temp_deg_c,
        load_torque_nm: job.conditions.load_torque_nm,
        time_s: stored.iter().map(|&n| (n as f64 / rate) as f32).collect(),
        setpoint: stored.iter().map(|&n| setpoints[n] as f32).collect(),
        measured_i_q_a: fit.i_q_measured,
        fitted_i_q_a: fit.i_q_fitted,
        measured_speed_rad_s: fit.omega_measured,
        fitted_speed_rad_s: fit.omega_fitted,
        measured_position_rad: fit.theta_out_measured,
        fitted_position_rad: fit.theta_out_fitted,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use ema_models::SensedSample;

    use super::*;
    use crate::config::Config;
    use crate::sample::MeasuredConditions;
    use crate::window::{Window, WindowQuality};

    #[test]
    fn a_sample_that_was_filled_in_was_not_received() {
        let config = Config::default();
        let actuator = config.actuators()[0].clone();
        let sample = |seq| SensedSample {
            seq,
            currents: [0.0; 3],
            motor_counts: 0,
            output_counts: 0,
            setpoint: Setpoint::Idle,
        };
        let job = WindowJob {
            params: actuator.params,
            actuator: Arc::new(actuator),
            window: Window {
                number: 0,
                t_start_ns: 0,
                trigger: 0,
                samples: (0..10).map(sample).collect(),
                expected: 10,
                quality: WindowQuality::Complete,
                lost: 2,
                rejected: 1,
                filled: vec![4, 5, 7],
                duplicates: 0,
                clock_jumps: 0,
                output_zero_rad: None,
            },
            conditions: MeasuredConditions::default(),
            operating_s: 0.0,
        };
        let record = window_record(&job, WindowStatus::Degraded, "", Fit::default());
        let counts = [record.samples_expected, record.samples, record.samples_lost];
        assert_eq!((counts, record.time_s.len()), ([10, 8, 2], 7));
    }
}

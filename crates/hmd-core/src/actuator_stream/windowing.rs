//! What cuts the windows of an actuator, made once the rate of its samples is known.

use std::sync::Arc;

use ema_models::{ActuatorParams, SensedSample};

use super::begun_by::BegunBy;
use super::free_zero::move_set_point_to_rest;
use crate::config::ActuatorConfig;
use crate::history::RunEnd;
use crate::log_map::{Gap, Quantity};
use crate::outbox::{Outbox, WindowJob};
use crate::sample::{MeasuredConditions, SampleRate};
use crate::window::{Window, WindowConfig, Windower};

/// Made with the first sample whose rate is known.
#[derive(Debug)]
pub(super) enum Windowing {
    Waiting,
    Ready(Box<ReadyWindowing>),
    /// The actuator cannot be monitored.
    Refused,
}

#[derive(Debug)]
pub(super) struct ReadyWindowing {
    /// Parameters with the sample rate of the windows.
    params: ActuatorParams,
    pub(super) windower: Windower,
    /// What begins the windows.
    pub(super) begun_by: BegunBy,
    /// Samples with a mode other than idle; without set point those in motion.
    operating: u64,
    /// Time of operation before, s.
    operated_before_s: f64,
}

impl Windowing {
    /// With the first sample whose rate is known; refused where the actuator cannot be monitored at it.
    pub(super) fn begin(
        actuator: &ActuatorConfig,
        window_config: WindowConfig,
        rate: SampleRate,
        before: RunEnd,
        stamp_ns: u64,
        outbox: &mut Outbox,
    ) -> Self {
        let name = &actuator.name;
        let mut params = actuator.params;
        let nominal = params.sensors.sample_rate;
        // The device samples in whole control periods; its clock and its sender jitter by more than that is off.
        let control_s = params.controller.period;
        let whole = (1.0 / (rate.hz * control_s)).round().max(1.0);
        let whole_hz = 1.0 / (whole * control_s);
        let is_whole = rate.is_measured && (whole_hz / rate.hz - 1.0).abs() < rate.uncertainty;
        let rate = SampleRate {
            hz: if is_whole { whole_hz } else { rate.hz },
            ..rate
        };
        params.sensors.sample_rate = rate.hz;
        if (rate.hz - nominal).abs() > 1e-3 * nominal {
            let found = rate.hz;
            outbox.push_notice(
                stamp_ns,
                format!("{name}: expected {nominal} samples/s, found {found:.1}; windows are cut at the rate found"),
            );
        }
        let made = match params.checked() {
            Ok(params) => Windower::new(window_config, &params)
                .map(|windower| windower.numbered_from(before.next_window))
                .map(|windower| match &actuator.log {
                    Some(log) if !log.has(Quantity::Counter) => windower.numbered_by_time(),
                    _ => windower,
                })
                .map(|windower| {
                    let drive = actuator.drive_bus.as_ref();
                    windower.with_quadrature_max(drive.and_then(|drive| drive.quadrature_max()))
                })
                .map(|windower| match &actuator.log {
                    Some(log) if log.gaps().any(|gap| gap == Gap::DirectCurrent) => windower.of_quadrature_alone(),
                    _ => windower,
                })
                .map(|windower| {
                    if actuator.has_set_point() {
                        windower
                    } else {
                        windower.triggered_by_motion()
                    }
                })
                .map(|windower| {
                    Self::Ready(Box::new(ReadyWindowing {
                        begun_by: BegunBy::of(actuator, &params, &window_config),
                        params,
                        windower: if rate.is_measured {
                            windower.at_device_time()
                        } else {
                            windower
                        },
                        operating: 0,
                        operated_before_s: before.operated_s,
                    }))
                })
                .map_err(|e| e.to_string()),
            Err(_) if rate.is_measured => Err(format!(
                "its clock shows {:.1} samples/s, of a period that is no whole number of control periods of {} ms{}",
                rate.hz,
                1e3 * control_s,
                advice_for_rate(actuator, rate.hz)
            )),
            Err(e) => Err(e.to_string()),
        };
        made.unwrap_or_else(|why| {
            outbox.push_notice(stamp_ns, format!("{name}: not monitored: {why}"));
            Self::Refused
        })
    }
}

impl ReadyWindowing {
    pub(super) fn count_operation(&mut self, sample: &SensedSample) {
        self.operating += u64::from(self.begun_by.is_operating(sample));
    }

    pub(super) fn job(
        &self,
        actuator: &Arc<ActuatorConfig>,
        mut window: Window,
        conditions: MeasuredConditions,
    ) -> WindowJob {
        if !actuator.has_output_angle() {
            move_set_point_to_rest(&mut window, &self.params);
        }
        WindowJob {
            actuator: actuator.clone(),
            params: self.params,
            window,
            conditions,
            operating_s: self.operated_s(),
        }
    }

    /// What the next windowing of the actuator goes on with.
    pub(super) fn continued(&self) -> RunEnd {
        RunEnd {
            next_window: self.windower.next_number(),
            operated_s: self.operated_s(),
        }
    }

    fn operated_s(&self) -> f64 {
        self.operated_before_s + self.operating as f64 / self.params.sensors.sample_rate
    }
}

/// What to do about a rate that no window can have.
fn advice_for_rate(actuator: &ActuatorConfig, rate_hz: f64) -> String {
    let control_s = actuator.params.controller.period;
    let usable_hz = 1.0 / ((1.0 / (rate_hz * control_s)).ceil().max(1.0) * control_s);
    match &actuator.log {
        Some(log) if log.resampling().is_none() => format!(
            "; resample_hz = {usable_hz:.0} in [map] interpolates its values, clock = \"receiver\" there takes the rate of the type"
        ),
        _ => format!(
            "; if that is wrong, leave sample.time out of the map and set sensors.sample_rate_hz of type {}",
            actuator.type_name
        ),
    }
}

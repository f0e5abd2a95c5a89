//! What the last window of each actuator showed, as metrics.

use std::collections::BTreeMap;
use std::fmt;

use ema_models::FaultId;
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::gauge::ConstGauge;

use crate::last_window::LastWindow;
use crate::record::{Health, Rul};
use crate::windows_in_a_row::WindowsInARow;

/// Quantiles of the remaining life, as labels.
const PERCENTILES: [&str; 3] = ["10", "50", "90"];

/// Seconds of an hour.
const HOUR_S: f64 = 3600.0;

/// What is known by the last windows. A value that is not known has no metric.
#[derive(Clone, Debug, Default)]
pub struct LastWindows {
    config_hash: String,
    actuators: BTreeMap<String, LastWindow>,
}

impl LastWindows {
    /// Of a run with the configuration of this hash, before its first window.
    #[must_use]
    pub fn new(config_hash: String) -> Self {
        Self {
            config_hash,
            actuators: BTreeMap::new(),
        }
    }

    /// Takes a window, and what it has in common with those before. What it does not show is no longer known.
    pub fn update(&mut self, health: &Health, rul: &Rul, in_a_row: &WindowsInARow) {
        self.resume(&health.actuator, LastWindow::new(health, rul, in_a_row));
    }

    /// Takes the last window of an earlier run, which holds until the next one.
    pub fn resume(&mut self, actuator: &str, last: LastWindow) {
        self.actuators.insert(actuator.to_owned(), last);
    }
}

impl Collector for LastWindows {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), fmt::Error> {
        let out = &mut encoder;
        info(
            out,
            "build_info",
            "Version of the program",
            ("version", env!("CARGO_PKG_VERSION")),
        )?;
        if !self.config_hash.is_empty() {
            info(
                out,
                "config_info",
                "Hash of the configuration, as recordings have it",
                ("hash", &self.config_hash),
            )?;
        }
        if self.actuators.is_empty() {
            return Ok(());
        }
        let help = "Start of the last window of an actuator, UTC";
        let name = "last_window_timestamp_seconds";
        let mut starts = out.encode_descriptor(name, help, None, MetricType::Gauge)?;
        for (actuator, last) in &self.actuators {
            let labels = [("actuator", actuator.as_str())];
            ConstGauge::new(1e-9 * last.t_start_ns as f64).encode(starts.encode_family(&labels)?)?;
        }
        let help = "Newest windows in a row that could not be assessed";
        let mut unassessed = out.encode_descriptor("unassessed_windows", help, None, MetricType::Gauge)?;
        for (actuator, last) in &self.actuators {
            let labels = [("actuator", actuator.as_str())];
            ConstGauge::new(last.in_a_row.unassessed).encode(unassessed.encode_family(&labels)?)?;
        }
        let help = "Newest windows in a row that name a sensor, wire or number to check";
        let mut suspected = out.encode_descriptor("suspected_windows", help, None, MetricType::Gauge)?;
        for (actuator, last) in &self.actuators {
            for (suspect, windows) in &last.in_a_row.suspects {
                let labels = [("actuator", actuator.as_str()), ("suspect", suspect)];
                ConstGauge::new(*windows).encode(suspected.encode_family(&labels)?)?;
            }
        }
        let help = "State of a fault by the last window, as hmd_health";
        let mut states = out.encode_descriptor("fault_state", help, None, MetricType::Gauge)?;
        for (actuator, last) in &self.actuators {
            for (fault, state) in FaultId::ALL.into_iter().zip(last.states.into_iter().flatten()) {
                let labels = [
                    ("actuator", actuator.as_str()),
                    ("fault", fault.name()),
                    ("part", fault.part()),
                ];
                ConstGauge::new(state as u64).encode(states.encode_family(&labels)?)?;
            }
        }
        let help = "Damage by the last window, 0 to 1";
        self.of_faults(out, "damage", help, |(damage, _)| damage)?;
        let help = "Standard deviation of hmd_damage";
        self.of_faults(out, "damage_sigma", help, |(_, sigma)| sigma)?;
        let help = "Time left, of operation, or of the clock with rul.hours = elapsed: 10, 50 and 90 % quantile";
        let mut lives = out.encode_descriptor("rul_seconds", help, None, MetricType::Gauge)?;
        for (actuator, last) in &self.actuators {
            for (percentile, hours) in PERCENTILES.iter().zip(last.rul_h) {
                let labels = [("actuator", actuator.as_str()), ("percentile", percentile)];
                if let Some(hours) = hours {
                    ConstGauge::new(HOUR_S * hours).encode(lives.encode_family(&labels)?)?;
                }
            }
        }
        Ok(())
    }
}

impl LastWindows {
    fn of_faults(
        &self,
        out: &mut DescriptorEncoder<'_>,
        name: &str,
        help: &str,
        value: impl Fn((Option<f64>, Option<f64>)) -> Option<f64>,
    ) -> fmt::Result {
        let mut values = out.encode_descriptor(name, help, None, MetricType::Gauge)?;
        for (actuator, last) in &self.actuators {
            for (fault, of_fault) in FaultId::ALL.into_iter().zip(last.damage) {
                let labels = [("actuator", actuator.as_str()), ("fault", fault.name())];
                if let Some(value) = value(of_fault) {
                    ConstGauge::new(value).encode(values.encode_family(&labels)?)?;
                }
            }
        }
        Ok(())
    }
}

/// A fact that does not change, as a label of a 1.
fn info(out: &mut DescriptorEncoder<'_>, name: &str, help: &str, label: (&str, &str)) -> fmt::Result {
    let mut fact = out.encode_descriptor(name, help, None, MetricType::Gauge)?;
    ConstGauge::new(1).encode(fact.encode_family(&[label])?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::health::HealthState;
    use crate::metrics::render;
    use crate::record::Status;

    #[test]
    fn what_is_not_known_has_no_metric() {
        let mut last = LastWindows::new("ab12".to_owned());
        let health = Health {
            actuator: "ema3".to_owned(),
            t_start_ns: 1_700_000_000_500_000_000,
            damage_friction: Some(0.25),
            k1_sigma: Some(0.01),
            damage_gain: Some(0.1),
            k8_sigma: Some(0.02),
            k2_sigma: Some(0.5),
            ..Health::default()
        };
        let mut health = health;
        let mut states = [HealthState::Nominal; FaultId::COUNT];
        states[FaultId::ShortA.index()] = HealthState::Warning;
        health.set_states(&states);
        let rul = Rul {
            rul_p10_h: Some(2.0),
            ..Rul::default()
        };
        last.update(&health, &rul, &WindowsInARow::default());
        let text = render(&Status::default(), &last);
        for line in [
            "hmd_config_info{hash=\"ab12\"} 1",
            "hmd_last_window_timestamp_seconds{actuator=\"ema3\"} 1700000000.5",
            "hmd_fault_state{actuator=\"ema3\",fault=\"short_a\",part=\"stator winding, phase A\"} 3",
            "hmd_fault_state{actuator=\"ema3\",fault=\"gain\",part=\"position controller\"} 1",
            "hmd_damage{actuator=\"ema3\",fault=\"friction\"} 0.25",
            "hmd_damage_sigma{actuator=\"ema3\",fault=\"friction\"} 0.01",
            "hmd_damage_sigma{actuator=\"ema3\",fault=\"gain\"} 0.04",
            "hmd_rul_seconds{actuator=\"ema3\",percentile=\"10\"} 7200.0",
        ] {
            assert!(text.lines().any(|found| found == line), "{line} in\n{text}");
        }
        assert!(
            !text.contains("damage{actuator=\"ema3\",fault=\"backlash") && !text.contains("percentile=\"50\""),
            "{text}"
        );
        last.update(
            &Health {
                actuator: "ema3".to_owned(),
                ..Health::default()
            },
            &Rul::default(),
            &WindowsInARow::default(),
        );
        let text = render(&Status::default(), &last);
        assert!(!text.contains("friction"), "{text}");
    }
}

//! The counters of a [`Status`] as Prometheus metrics: in OpenMetrics for scrapers, in the text format for the textfile collector.

pub mod last_windows;
mod text_format;

pub use text_format::in_text_format;

use std::fmt;

use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::counter::ConstCounter;
use prometheus_client::metrics::gauge::ConstGauge;
use prometheus_client::registry::Registry;

use crate::health::HealthState;
use crate::record::{ActuatorStatus, Status, StorageState, WindowStatus};
use last_windows::LastWindows;

/// The metrics of `docs/metrics.md`, which is made from them, in OpenMetrics.
#[must_use]
pub fn render(status: &Status, last: &LastWindows) -> String {
    let mut registry = Registry::with_prefix("hmd");
    registry.register_collector(Box::new(Snapshot(status.clone())));
    registry.register_collector(Box::new(last.clone()));
    let mut out = String::new();
    text::encode(&mut out, &registry).expect("writing to a String does not fail");
    out
}

#[derive(Debug)]
struct Snapshot(Status);

impl Collector for Snapshot {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), fmt::Error> {
        let status = &self.0;
        let out = &mut encoder;
        let frames = [
            ("decoded", status.frames_decoded),
            ("filtered", status.frames_filtered),
            ("error", status.frames_error),
        ];
        counters(
            out,
            "frames",
            "Frames received, by what became of them",
            "outcome",
            &frames,
        )?;
        let help = "What was lost, by cause: the counts of the status record";
        counters(out, "lost", help, "cause", &status.losses())?;
        let windows = [
            (WindowStatus::Ok.name(), status.windows_ok),
            (WindowStatus::Degraded.name(), status.windows_degraded),
            (WindowStatus::Invalid.name(), status.windows_invalid),
            (WindowStatus::Unmodelled.name(), status.windows_unmodelled),
        ];
        counters(out, "windows", "Windows, by status", "status", &windows)?;
        counter(
            out,
            "samples",
            "Complete samples of all actuators",
            status.samples as f64,
        )?;
        let help = "Times the sample counter of a device began anew or went back";
        counter(out, "device_restarts", help, status.device_restarts as f64)?;
        let help = "Times the samples of an actuator changed their rate";
        counter(out, "rate_changes", help, status.rate_changes as f64)?;
        counter(
            out,
            "identification_seconds",
            "Time spent on identification",
            status.identification_s,
        )?;
        counter(
            out,
            "segments_deleted",
            "Segments deleted to make room",
            status.storage_deleted as f64,
        )?;
        // Without a folder of segments there is no disk to report of.
        let has_folder = !status.storage.is_empty();
        let of_folder = |value: u64| has_folder.then_some(value as f64);
        for (name, help, value) in [
            (
                "identification_max_seconds",
                "Longest identification of one window",
                Some(status.identification_max_s),
            ),
            (
                "record_age_seconds",
                "Time since the newest health record was stored",
                status.record_age_s,
            ),
            (
                "segment_bytes",
                "Bytes of all segments",
                of_folder(status.storage_used_bytes),
            ),
            (
                "disk_free_bytes",
                "Bytes free where the segments are",
                of_folder(status.storage_free_bytes),
            ),
            ("segments", "Segments", of_folder(status.storage_segments)),
        ] {
            if let Some(value) = value {
                let metric = out.encode_descriptor(name, help, None, MetricType::Gauge)?;
                ConstGauge::new(value).encode(metric)?;
            }
        }
        let queues = [("inputs", status.queued_inputs), ("windows", status.queued_windows)];
        gauges(out, "queued", "What waits in a queue", "queue", queues)?;
        if has_folder {
            let states = StorageState::ALL.map(|state| (state.name(), u64::from(status.storage == state.name())));
            let help = "1 for the state that the storage is in";
            gauges(out, "storage_state", help, "state", states)?;
        }
        of_actuators(out, status)?;
        let links = status.interfaces.iter();
        let links = links.map(|on| (on.interface.as_str(), u64::from(on.link == "up")));
        gauges(
            out,
            "link_up",
            "1 for an interface that can bring frames",
            "interface",
            links,
        )?;
        let passive = status.interfaces.iter();
        let passive = passive.map(|on| (on.interface.as_str(), u64::from(on.passive)));
        let help = "1 for an interface whose actuators are all passive";
        gauges(out, "link_passive", help, "interface", passive)
    }
}

/// How old the data of each actuator are, and what was made of them.
fn of_actuators(out: &mut DescriptorEncoder<'_>, status: &Status) -> fmt::Result {
    if status.actuators.is_empty() {
        return Ok(());
    }
    let each = |value: fn(&ActuatorStatus) -> u64| {
        let actuators = status.actuators.iter();
        actuators.map(move |actuator| (actuator.actuator.as_str(), value(actuator)))
    };
    let help = "Time since the newest sample of an actuator, or since the start";
    let mut ages = out.encode_descriptor("data_age_seconds", help, None, MetricType::Gauge)?;
    for of in &status.actuators {
        ConstGauge::new(of.data_age_s).encode(ages.encode_family(&[("actuator", of.actuator.as_str())])?)?;
    }
    let stale = each(|of| u64::from(of.is_stale()));
    gauges(
        out,
        "data_stale",
        "1 for an actuator whose data are stale",
        "actuator",
        stale,
    )?;
    let help = "Health by the last window: 0 unknown, 1 nominal, 2 watch, 3 warning, 4 critical";
    let rank = each(|of| HealthState::named(&of.health) as u64);
    gauges(out, "health", help, "actuator", rank)?;
    let help = "Level of the sensors by the last window, as hmd_health";
    let rank = each(|of| HealthState::named(&of.sensors) as u64);
    gauges(out, "sensors", help, "actuator", rank)?;
    let help = "Windows in a row that ask for a worse health";
    gauges(out, "persistence", help, "actuator", each(|of| of.persistence))?;
    let passive = each(|of| u64::from(of.passive));
    gauges(
        out,
        "passive",
        "1 for an actuator whose health raises no alarm",
        "actuator",
        passive,
    )
}

fn counter(out: &mut DescriptorEncoder<'_>, name: &str, help: &str, value: f64) -> fmt::Result {
    let metric = out.encode_descriptor(name, help, None, MetricType::Counter)?;
    ConstCounter::new(value).encode(metric)
}

fn counters(
    out: &mut DescriptorEncoder<'_>,
    name: &str,
    help: &str,
    label: &str,
    values: &[(&str, u64)],
) -> fmt::Result {
    let mut family = out.encode_descriptor(name, help, None, MetricType::Counter)?;
    for (of, count) in values {
        ConstCounter::new(*count).encode(family.encode_family(&[(label, *of)])?)?;
    }
    Ok(())
}

fn gauges<'a>(
    out: &mut DescriptorEncoder<'_>,
    name: &str,
    help: &str,
    label: &str,
    values: impl IntoIterator<Item = (&'a str, u64)>,
) -> fmt::Result {
    let mut family = out.encode_descriptor(name, help, None, MetricType::Gauge)?;
    for (of, value) in values {
        ConstGauge::new(value).encode(family.encode_family(&[(label, of)])?)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::InterfaceStatus;

    fn status() -> Status {
        Status {
            frames_decoded: 7,
            lost_socket_queue: 3,
            lost_captures: 2,
            device_restarts: 4,
            rate_changes: 1,
            windows_ok: 2,
            identification_s: 1.5,
            record_age_s: Some(0.25),
            storage: "ok".to_owned(),
            storage_free_bytes: 1 << 40,
            interfaces: vec![InterfaceStatus {
                interface: "can0".to_owned(),
                link: "up".to_owned(),
                passive: true,
                ..InterfaceStatus::default()
            }],
            actuators: vec![ActuatorStatus {
                actuator: "ema3".to_owned(),
                data_age_s: 4.5,
                data_state: "STALE".to_owned(),
                health: "watch".to_owned(),
                sensors: "warning".to_owned(),
                persistence: 2,
                passive: true,
                ..ActuatorStatus::default()
            }],
            ..Status::default()
        }
    }

    #[test]
    fn in_the_text_format_every_sample_belongs_to_a_family_with_its_type() {
        let open = render(&status(), &LastWindows::new("ab12".to_owned()));
        let text = in_text_format(&open);
        let families: Vec<&str> = text
            .lines()
            .filter_map(|line| line.strip_prefix("# TYPE ")?.split(' ').next())
            .collect();
        let samples = |text: &str| {
            let samples = text.lines().filter(|line| !line.starts_with('#'));
            samples.map(str::to_owned).collect::<Vec<_>>()
        };
        for sample in samples(&text) {
            let name = sample.split(['{', ' ']).next().unwrap_or_default();
            assert!(families.contains(&name), "{sample} in\n{text}");
        }
        assert_eq!(samples(&text), samples(&open));
        assert!(
            text.starts_with("# HELP hmd_frames_total ") && !text.contains("# EOF"),
            "{text}"
        );
    }

    #[test]
    fn every_metric_is_there_once_with_its_type() {
        let text = render(&status(), &LastWindows::default());
        for line in [
            "# TYPE hmd_frames counter",
            "hmd_frames_total{outcome=\"decoded\"} 7",
            "hmd_lost_total{cause=\"socket_queue\"} 3",
            "hmd_windows_total{status=\"ok\"} 2",
            "hmd_device_restarts_total 4.0",
            "hmd_rate_changes_total 1.0",
            "hmd_identification_seconds_total 1.5",
            "hmd_record_age_seconds 0.25",
            "hmd_disk_free_bytes 1099511627776.0",
            "hmd_storage_state{state=\"ok\"} 1",
            "hmd_storage_state{state=\"failing\"} 0",
            "hmd_link_up{interface=\"can0\"} 1",
            "hmd_link_passive{interface=\"can0\"} 1",
            "hmd_lost_total{cause=\"captures\"} 2",
            "hmd_data_age_seconds{actuator=\"ema3\"} 4.5",
            "hmd_data_stale{actuator=\"ema3\"} 1",
            "hmd_health{actuator=\"ema3\"} 2",
            "hmd_sensors{actuator=\"ema3\"} 3",
            "hmd_persistence{actuator=\"ema3\"} 2",
            "hmd_passive{actuator=\"ema3\"} 1",
        ] {
            assert_eq!(
                text.lines().filter(|found| *found == line).count(),
                1,
                "{line} in\n{text}"
            );
        }
        assert!(
            !render(&Status::default(), &LastWindows::default()).contains("record_age"),
            "absent before the first record"
        );
    }

    #[test]
    fn without_a_folder_of_segments_no_disk_is_reported_full() {
        let alone = Status {
            storage: String::new(),
            ..status()
        };
        let text = render(&alone, &LastWindows::default());
        for name in ["disk_free_bytes", "segment_bytes", "hmd_segments ", "storage_state"] {
            assert!(!text.contains(name), "{name} in\n{text}");
        }
    }
}

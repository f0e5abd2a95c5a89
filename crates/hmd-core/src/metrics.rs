//! The counters of a [`Status`] as Prometheus metrics, in the text form that scrapers and the textfile collector read.

use std::fmt;

use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::counter::ConstCounter;
use prometheus_client::metrics::gauge::ConstGauge;
use prometheus_client::registry::Registry;

use crate::record::Status;

/// The metrics of `docs/metrics.md`, which is made from them.
#[must_use]
pub fn render(status: &Status) -> String {
    let mut registry = Registry::with_prefix("hmd");
    registry.register_collector(Box::new(Snapshot(status.clone())));
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
            ("ok", status.windows_ok),
            ("degraded", status.windows_degraded),
            ("invalid", status.windows_invalid),
            ("unmodelled", status.windows_unmodelled),
        ];
        counters(out, "windows", "Windows, by status", "status", &windows)?;
        counter(
            out,
            "samples",
            "Complete samples of all actuators",
            status.samples as f64,
        )?;
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
                Some(status.storage_used_bytes as f64),
            ),
            (
                "disk_free_bytes",
                "Bytes free where the segments are",
                Some(status.storage_free_bytes as f64),
            ),
            ("segments", "Segments", Some(status.storage_segments as f64)),
        ] {
            if let Some(value) = value {
                let metric = out.encode_descriptor(name, help, None, MetricType::Gauge)?;
                ConstGauge::new(value).encode(metric)?;
            }
        }
        let queues = [("inputs", status.queued_inputs), ("windows", status.queued_windows)];
        gauges(out, "queued", "What waits in a queue", "queue", queues)?;
        let states = ["ok", "raw-paused", "failing"];
        let states = states.map(|state| (state, u64::from(status.storage == state)));
        gauges(
            out,
            "storage_state",
            "1 for the state that the storage is in",
            "state",
            states,
        )?;
        of_actuators(out, status)?;
        let links = status.interface.iter().zip(&status.link);
        let links = links.map(|(name, link)| (name.as_str(), u64::from(link == "up")));
        gauges(
            out,
            "link_up",
            "1 for an interface that can bring frames",
            "interface",
            links,
        )
    }
}

/// How old the data of each actuator are, and what was made of them.
fn of_actuators(out: &mut DescriptorEncoder<'_>, status: &Status) -> fmt::Result {
    let names = || status.actuator.iter().map(String::as_str);
    if status.actuator.is_empty() {
        return Ok(());
    }
    let help = "Time since the newest sample of an actuator, or since the start";
    let mut ages = out.encode_descriptor("data_age_seconds", help, None, MetricType::Gauge)?;
    for (name, age) in names().zip(&status.data_age_s) {
        ConstGauge::new(*age).encode(ages.encode_family(&[("actuator", name)])?)?;
    }
    let stale = names().zip(status.data_state.iter().map(|state| u64::from(state == "STALE")));
    gauges(
        out,
        "data_stale",
        "1 for an actuator whose data are stale",
        "actuator",
        stale,
    )?;
    let rank = |state: &String| HEALTH.iter().position(|of| of == state).unwrap_or(0) as u64;
    let help = "Health by the last window: 0 unknown, 1 nominal, 2 watch, 3 warning, 4 critical";
    gauges(
        out,
        "health",
        help,
        "actuator",
        names().zip(status.health.iter().map(rank)),
    )?;
    let help = "Windows in a row that ask for a worse health";
    let pending = names().zip(status.persistence.iter().copied());
    gauges(out, "persistence", help, "actuator", pending)?;
    let passive = names().zip(status.passive.iter().map(|passive| u64::from(*passive)));
    gauges(
        out,
        "passive",
        "1 for an actuator whose health alarms nobody",
        "actuator",
        passive,
    )
}

/// In the order of their numbers.
const HEALTH: [&str; 5] = ["unknown", "nominal", "watch", "warning", "critical"];

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

    fn status() -> Status {
        Status {
            frames_decoded: 7,
            lost_socket_queue: 3,
            windows_ok: 2,
            identification_s: 1.5,
            record_age_s: Some(0.25),
            storage: "ok".to_owned(),
            storage_free_bytes: 1 << 40,
            interface: vec!["can0".to_owned()],
            link: vec!["up".to_owned()],
            actuator: vec!["ema3".to_owned()],
            data_age_s: vec![4.5],
            data_state: vec!["STALE".to_owned()],
            health: vec!["watch".to_owned()],
            persistence: vec![2],
            passive: vec![true],
            ..Status::default()
        }
    }

    #[test]
    fn every_metric_is_there_once_with_its_type() {
        let text = render(&status());
        for line in [
            "# TYPE hmd_frames counter",
            "hmd_frames_total{outcome=\"decoded\"} 7",
            "hmd_lost_total{cause=\"socket_queue\"} 3",
            "hmd_windows_total{status=\"ok\"} 2",
            "hmd_identification_seconds_total 1.5",
            "hmd_record_age_seconds 0.25",
            "hmd_disk_free_bytes 1099511627776.0",
            "hmd_storage_state{state=\"ok\"} 1",
            "hmd_storage_state{state=\"failing\"} 0",
            "hmd_link_up{interface=\"can0\"} 1",
            "hmd_data_age_seconds{actuator=\"ema3\"} 4.5",
            "hmd_data_stale{actuator=\"ema3\"} 1",
            "hmd_health{actuator=\"ema3\"} 2",
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
            !render(&Status::default()).contains("record_age"),
            "absent before the first record"
        );
    }
}

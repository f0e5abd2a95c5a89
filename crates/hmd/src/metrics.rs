//! The counters of a [`Status`] as Prometheus metrics, in the text form that scrapers and the textfile collector read.

use std::fmt;
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::counter::ConstCounter;
use prometheus_client::metrics::gauge::ConstGauge;
use prometheus_client::registry::Registry;

use crate::record::Status;

/// The metrics of `docs/deploy.md`.
#[must_use]
pub fn render(status: &Status) -> String {
    let mut registry = Registry::with_prefix("hmd");
    registry.register_collector(Box::new(Snapshot(status.clone())));
    let mut out = String::new();
    text::encode(&mut out, &registry).expect("writing to a String does not fail");
    out
}

/// Puts rendered metrics into a file in one step: a reader sees the old or the new ones.
///
/// # Errors
/// What the system says.
pub fn write_textfile(path: &Path, metrics: &str) -> io::Result<()> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".tmp");
    File::create(&beside)?.write_all(metrics.as_bytes())?;
    std::fs::rename(beside, path)
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
        let lost = [
            ("unreadable", status.lost_unreadable),
            ("damaged", status.lost_damaged),
            ("socket_queue", status.lost_socket_queue),
            ("own_queue", status.lost_own_queue),
            ("samples", status.lost_samples),
            ("malformed", status.lost_malformed),
            ("windows", status.lost_windows),
            ("late", status.lost_late),
            ("storage_frames", status.lost_storage_frames),
            ("storage_records", status.lost_storage_records),
        ];
        let help = "What was lost, by cause: the counts of the status record";
        counters(out, "lost", help, "cause", &lost)?;
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

    #[test]
    fn the_textfile_is_replaced_as_a_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hmd.prom");
        write_textfile(&path, &render(&Status::default())).unwrap();
        write_textfile(&path, &render(&status())).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), render(&status()));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

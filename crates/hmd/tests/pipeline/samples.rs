//! Samples out of logs and into windows again: what the Python package stands on.

use std::sync::{Arc, Mutex};

use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::ActuatorId;
use hmd_core::actuator_stream::cut_windows;
use hmd_core::config::Config;
use hmd_core::demux::Demux;
use hmd_core::frame::BusNames;
use hmd_ingest::candump::{Decimals, emit};
use hmd_lab::simulate::{EPOCH_NS, traffic};
use hmd_report::export::{ExportError, Sources, Table, Value, export_raw, raw_heads};

fn scenario() -> Scenario {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = 400.0;
    Scenario {
        actuations: Actuations {
            profile: Profile::Mixed,
            count: 2,
            rest: 0.5,
            length: 0.5,
        },
        ..Scenario::new(params, FaultVector::NOMINAL, 3)
    }
}

#[test]
fn windows_cut_from_taken_samples_are_those_of_the_frames() {
    let config = Arc::new(Config::default());
    let mut names = BusNames::new();
    names.intern("can0").unwrap();
    let mut demux = Demux::new(config.clone()).collecting_samples();
    let mut taken = Vec::new();
    for frame in traffic(&scenario(), ActuatorId::new(2).unwrap(), EPOCH_NS) {
        demux.push(&frame, &names);
        taken.extend(demux.take_samples());
    }
    demux.finish();
    let ended = demux.take_windows();
    assert!(demux.take_samples().is_empty(), "nothing is delivered twice");
    let (_, samples, counts) = demux.actuators().next().unwrap();
    assert_eq!((taken.len() as u64, counts.lost), (samples, 0));
    assert!(taken.windows(2).all(|two| two[1].sample.seq == two[0].sample.seq + 1));

    let last = taken.last().unwrap();
    assert_eq!(last.actuator.name, "ema2");
    let samples = taken.iter().map(|taken| taken.sample);
    let (again, notices) = cut_windows(&config, &last.actuator, last.rate, last.conditions, samples);
    assert_eq!((ended.len(), again.len()), (2, 2));
    assert_eq!(notices, demux.take_notices());
    for (ours, theirs) in again.iter().zip(&ended) {
        assert_eq!(ours.window, theirs.window);
        assert_eq!(ours.params, theirs.params);
        assert_eq!(ours.operating_s.to_bits(), theirs.operating_s.to_bits());
    }
}

#[test]
fn a_demux_keeps_no_samples_unless_asked() {
    let mut names = BusNames::new();
    names.intern("can0").unwrap();
    let mut demux = Demux::new(Arc::new(Config::default()));
    for frame in traffic(&scenario(), ActuatorId::new(0).unwrap(), EPOCH_NS) {
        demux.push(&frame, &names);
    }
    assert!(demux.take_samples().is_empty());
}

#[derive(Clone, Default)]
struct Rows(Arc<Mutex<Vec<Vec<Value>>>>);

impl Table for Rows {
    fn row(&mut self, row: Vec<Value>) -> Result<(), ExportError> {
        self.0.lock().expect("nobody panicked").push(row);
        Ok(())
    }

    fn finish(self: Box<Self>, _: &Sources) -> Result<(), ExportError> {
        Ok(())
    }
}

#[test]
fn a_log_is_a_table_of_samples() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("a.log");
    let mut text = Vec::new();
    for frame in traffic(&scenario(), ActuatorId::new(0).unwrap(), EPOCH_NS) {
        emit(&frame, "can0", Decimals::Six, &mut text);
    }
    std::fs::write(&log, &text).unwrap();
    let rows = Rows::default();
    let export = |table| {
        let mut told = Vec::new();
        let config = Arc::new(Config::default());
        let exported = export_raw(&[&log], config, table, &mut |loss| told.push(loss.to_string())).unwrap();
        (exported, told)
    };
    let (exported, told) = export(Box::new(rows.clone()));
    let rows = rows.0.lock().unwrap();
    assert_eq!((exported.rows, exported.lost, told.len()), (rows.len() as u64, None, 0));
    assert_eq!(rows.len(), scenario().run().count());
    let place = |name: &str| raw_heads().iter().position(|head| head.name == name).unwrap();
    assert_eq!(rows[0][place("t_ns")], Value::Time(EPOCH_NS));
    assert_eq!(rows[0][place("sample_rate_hz")], Value::Number(Some(400.0)));
    assert_eq!(rows[0][place("mode")], Value::Text("position".to_owned()));

    text.extend(b"no frame\n");
    std::fs::write(&log, text).unwrap();
    let (damaged, told) = export(Box::<Rows>::default());
    assert_eq!(damaged.rows, exported.rows);
    assert_eq!(damaged.lost.as_deref(), Some("data lost: 1 unreadable line or frame"));
    let [place] = &told[..] else { panic!("{told:?}") };
    assert!(place.contains("a.log:") && place.contains("found \"no\""), "{place}");
}

//! What each estimator of a commissioned unit says of the same windows of the suite `robust`: one JSON line per window and estimator.
//!
//! `cargo run --release -p hmd-lab --example unit_estimators -- [KEY=VALUE]…`; lists are separated by commas. Keys: `rate` (Hz), `n`
//! (healthy windows of each unit, twice as many are faulty), `seed`, `entry`, `actuator`.

use std::collections::BTreeMap;
use std::error::Error;
use std::sync::Arc;

use ema_identify::unit_calibration::{UnitCalibration, UnitEstimator};
use hmd_core::assess::{Assessor, Models};
use hmd_core::commissioning::calibrate_unit;
use hmd_core::config::Config;
use hmd_core::frame::BusNames;
use hmd_core::outbox::WindowJob;
use hmd_core::pipeline::Pipeline;
use hmd_lab::evaluate::robust::{CatalogueUnit, entry_names};
use hmd_lab::simulate::{EPOCH_NS, traffic};
use rayon::prelude::*;
use serde_json::{Value, json};

/// Healthy windows to commission.
const COMMISSIONING: u64 = 12;

type Failed = Box<dyn Error + Send + Sync>;

fn main() -> Result<(), Failed> {
    let given: BTreeMap<String, String> = std::env::args()
        .skip(1)
        .filter_map(|arg| {
            arg.split_once('=')
                .map(|(key, value)| (key.to_owned(), value.to_owned()))
        })
        .collect();
    let text = |key: &str, otherwise: &str| given.get(key).cloned().unwrap_or_else(|| otherwise.to_owned());
    let rate: f64 = text("rate", "400").parse()?;
    let n: u64 = text("n", "4").parse()?;
    let seed: u64 = text("seed", "1").parse()?;
    let entries = text("entry", "");
    let actuators = text("actuator", "bench,servo28,servo270");
    let units: Vec<(&str, &str)> = entry_names()
        .filter(|name| entries.is_empty() || entries.split(',').any(|entry| entry == *name))
        .flat_map(|name| actuators.split(',').map(move |actuator| (name, actuator)))
        .collect();
    units.par_iter().try_for_each(|(entry, actuator)| {
        for line in lines_of(entry, actuator, rate, n, seed)? {
            println!("{line}");
        }
        Ok(())
    })
}

/// One line per window and estimator of a unit.
fn lines_of(entry: &str, actuator: &str, rate: f64, n: u64, seed: u64) -> Result<Vec<Value>, Failed> {
    let unit = CatalogueUnit::new(entry, actuator, rate, seed)?;
    let config = Arc::new(Config::from_toml_str(
        &format!(
            "[[actuator]]\nid = 0\ntype = \"{actuator}\"\ncalibration = \"unit.toml\"\n\
             [type.{actuator}.sensors]\nsample_rate_hz = {rate:?}"
        ),
        "unit_estimators.toml",
    )?);
    let of_type = Models::load_types(&config, &|_| Err(std::io::Error::from(std::io::ErrorKind::Unsupported)))?;
    let mut jobs = Vec::new();
    for number in 3 * n..3 * n + COMMISSIONING {
        jobs.extend(job(&config, &unit, number, n)?);
    }
    jobs.retain(|job| job.window.quality.is_fit());
    let name = format!("{entry}/{actuator}");
    let assessor = Assessor::new(config.clone(), of_type, seed);
    let commissioned = match calibrate_unit(&assessor, config.health().levels(), &mut jobs, seed, &|_| ()) {
        Ok(found) => found,
        Err(error) => return Ok(vec![json!({"unit": name, "refused": error.to_string()})]),
    };
    let calibration = commissioned.calibration;
    let mut lines = vec![
        json!({"unit": name, "chosen": format!("{:?}", calibration.estimator), "reason": calibration.estimator_reason, "notes": commissioned.notes,
            "baseline": calibration.monitor.map(|monitor| monitor.baseline.map(|element| [element.mean, element.scatter]))}),
    ];
    let with = |estimator: UnitEstimator| UnitCalibration {
        estimator,
        ..calibration.clone()
    };
    let mut kinds = Vec::new();
    if calibration.relations.is_some() {
        kinds.push(("relations", with(UnitEstimator::Relations)));
    }
    if calibration.monitor.is_some() {
        kinds.push(("monitor", with(UnitEstimator::Monitor)));
    }
    kinds.push(("own", calibration.clone()));
    for (kind, calibration) in kinds {
        let models = Models::load(&config, &|_| Ok(calibration.emit()))?;
        for number in 0..3 * n {
            let (place, scenario) = unit.window(number, n);
            let Some(job) = job(&config, &unit, number, n)? else {
                continue;
            };
            let assessed = Assessor::new(config.clone(), models.clone(), number).assess(job)?;
            let estimate = assessed.health.estimate();
            lines.push(json!({
                "unit": name, "estimator": kind, "window": number, "place": place, "truth": scenario.fault.to_array(),
                "status": assessed.health.status, "reason": assessed.health.reason, "faults": assessed.health.fault_list,
                "k": estimate.map(|found| found.k), "sigma": estimate.map(|found| found.sigma),
                "observable": estimate.map(|found| found.observable),
            }));
        }
    }
    Ok(lines)
}

/// The window of one mixed actuation as the pipeline cuts it.
fn job(config: &Arc<Config>, unit: &CatalogueUnit, number: u64, n: u64) -> Result<Option<WindowJob>, Failed> {
    let (_, scenario) = unit.window(number, n);
    let mut names = BusNames::new();
    names.intern("can0")?;
    let mut pipeline = Pipeline::new(config.clone());
    for frame in traffic(&scenario, config.actuators()[0].id, EPOCH_NS) {
        pipeline.push(&frame, &names);
    }
    pipeline.finish();
    let mut job = pipeline.take_windows().into_iter().next();
    if let Some(job) = &mut job {
        job.conditions.load_torque_nm = None;
    }
    Ok(job)
}

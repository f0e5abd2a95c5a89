//! What was learnt of a unit, in words.

use ema_identify::unit_calibration::{Deviation, UnitCalibration, UnitEstimator, UnitParameter};
use ema_models::FaultId;

/// What was learnt of a unit, in sentences.
#[must_use]
pub fn in_words(unit: &UnitCalibration) -> Vec<String> {
    let name = match unit.estimator {
        UnitEstimator::Monitor => "monitor",
        UnitEstimator::Relations => "relations between measured signals",
        UnitEstimator::Both => {
            "relations between measured signals and the monitor, each fault by the one that shows it better"
        }
    };
    let mut lines = vec![format!(
        "assessed by the {name} ({}), from {} windows",
        unit.estimator_reason, unit.windows
    )];
    if let (UnitEstimator::Monitor | UnitEstimator::Both, Some(monitor)) = (unit.estimator, &unit.monitor) {
        let deviations = UnitParameter::ALL.map(|parameter| {
            let Deviation { share, sigma } = monitor.parameters.of(parameter);
            format!("{} {:+.1} % ± {:.1} %", parameter.name(), 100.0 * share, 100.0 * sigma)
        });
        lines.push(format!("of type {}: {}", unit.actuator_type, deviations.join(", ")));
    }
    let smallest: Vec<String> = FaultId::ALL
        .into_iter()
        .map(|fault| match unit.smallest_damage.get(fault.name()) {
            Some(damage) => format!("{} {damage:.2}", fault.plain_name()),
            None => format!("{} not shown by these windows", fault.plain_name()),
        })
        .collect();
    lines.push(format!("smallest damage that shows: {}", smallest.join(", ")));
    lines
}

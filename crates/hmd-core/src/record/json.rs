//! One line of `hmd replay --json`.

use std::collections::BTreeMap;

use ema_models::FaultId;
use serde::Serialize;

use super::{Health, Rul, finite};
use crate::health::HealthState;

/// Quantiles of a remaining life.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Interval {
    /// 10 % quantile.
    pub p10: f64,
    /// Median.
    pub p50: f64,
    /// 90 % quantile.
    pub p90: f64,
}

impl Interval {
    /// The three quantiles, if all are there.
    #[must_use]
    pub fn new(p10: Option<f64>, p50: Option<f64>, p90: Option<f64>) -> Option<Self> {
        let finite = |value: Option<f64>| value.and_then(finite);
        Some(Self {
            p10: finite(p10)?,
            p50: finite(p50)?,
            p90: finite(p90)?,
        })
    }
}

/// The health of one window and the remaining life after it, as one JSON object.
///
/// The order of the fields is the order of the keys. An invalid or unmodelled window has null for `k`, `sigma`
/// and `observable`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HealthLine<'a> {
    actuator: &'a str,
    window: u64,
    t_start_ns: u64,
    status: &'a str,
    k: Option<[f64; 8]>,
    sigma: Option<[Option<f64>; 8]>,
    observable: Option<[bool; 8]>,
    cost: Option<f64>,
    residual_rms_a: Option<f64>,
    evaluations: u64,
    health: &'a str,
    faults: &'a [String],
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    suspects: &'a [String],
    rul_h: Option<Interval>,
    rul_cycles: Option<Interval>,
    #[serde(skip_serializing_if = "str::is_empty")]
    reason: &'a str,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    states: BTreeMap<&'static str, &'static str>,
}

impl<'a> HealthLine<'a> {
    /// The line of a window; `rul` is `None` while there is none.
    pub fn new(health: &'a Health, rul: Option<&Rul>) -> Self {
        let estimate = health.estimate();
        Self {
            actuator: &health.actuator,
            window: health.window,
            t_start_ns: health.t_start_ns,
            status: &health.status,
            k: estimate.map(|e| e.k),
            sigma: estimate.map(|e| e.sigma),
            observable: estimate.map(|e| e.observable),
            cost: health.cost.and_then(finite),
            residual_rms_a: health.residual_rms_a.and_then(finite),
            evaluations: health.evaluations,
            health: &health.health,
            faults: &health.fault_list,
            suspects: &health.suspects,
            rul_h: rul.and_then(|rul| Interval::new(rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h)),
            rul_cycles: rul.and_then(|rul| Interval::new(rul.rul_p10_cycles, rul.rul_p50_cycles, rul.rul_p90_cycles)),
            reason: &health.reason,
            states: health
                .states()
                .into_iter()
                .flat_map(|states| FaultId::NAMES.into_iter().zip(states.map(HealthState::name)))
                .collect(),
        }
    }

    /// The line without its line end.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).unwrap_or_else(|_| unreachable!("text, numbers and lists always serialise"))
    }
}

impl<'a> From<&'a Health> for HealthLine<'a> {
    fn from(health: &'a Health) -> Self {
        Self::new(health, None)
    }
}

impl<'a> From<(&'a Health, &'a Rul)> for HealthLine<'a> {
    fn from((health, rul): (&'a Health, &'a Rul)) -> Self {
        Self::new(health, Some(rul))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Estimate;

    #[test]
    fn the_line_is_the_documented_one() {
        let mut health = Health {
            actuator: "ema0".to_owned(),
            t_start_ns: 1_700_000_000_000_000_000,
            status: "ok".to_owned(),
            health: "watch".to_owned(),
            cost: Some(0.1),
            residual_rms_a: Some(0.05),
            evaluations: 1500,
            ..Health::default()
        };
        let mut sigma = [Some(0.001); 8];
        sigma[6] = None;
        let mut observable = [true; 8];
        observable[6] = false;
        health.set_estimate(Some(&Estimate {
            k: [0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5],
            sigma,
            observable,
        }));
        health.set_faults(&[ema_models::FaultId::Friction]);
        let rul = Rul {
            rul_p10_h: Some(100.0),
            rul_p50_h: Some(140.0),
            rul_p90_h: Some(200.0),
            rul_p10_cycles: Some(1.0),
            ..Rul::default()
        };
        let expected = concat!(
            r#"{"actuator":"ema0","window":0,"t_start_ns":1700000000000000000,"status":"ok","#,
            r#""k":[0.25,0.0,0.0,0.0,0.0,0.0,0.5,0.5],"sigma":[0.001,0.001,0.001,0.001,0.001,0.001,null,0.001],"#,
            r#""observable":[true,true,true,true,true,true,false,true],"#,
            r#""cost":0.1,"residual_rms_a":0.05,"evaluations":1500,"#,
            r#""health":"watch","faults":["friction"],"rul_h":{"p10":100.0,"p50":140.0,"p90":200.0},"rul_cycles":null}"#,
        );
        assert_eq!(HealthLine::from((&health, &rul)).to_json(), expected);
        health.set_states(&[HealthState::Watch; FaultId::COUNT]);
        let states = concat!(
            r#","states":{"backlash":"watch","eccentricity":"watch","friction":"watch","gain":"watch","#,
            r#""short_a":"watch","short_b":"watch","short_c":"watch"}}"#,
        );
        let line = HealthLine::from((&health, &rul)).to_json();
        assert_eq!(line.strip_suffix(states), expected.strip_suffix('}'));
    }

    #[test]
    fn an_invalid_window_has_a_reason_and_no_estimate() {
        let health = Health {
            actuator: "ema0".to_owned(),
            status: "invalid".to_owned(),
            health: "unknown".to_owned(),
            reason: "12 of 1000 samples".to_owned(),
            suspects: vec!["load sensor".to_owned()],
            ..Health::default()
        };
        let expected = concat!(
            r#"{"actuator":"ema0","window":0,"t_start_ns":0,"status":"invalid","k":null,"sigma":null,"#,
            r#""observable":null,"cost":null,"residual_rms_a":null,"evaluations":0,"health":"unknown","faults":[],"suspects":["load sensor"],"#,
            r#""rul_h":null,"rul_cycles":null,"reason":"12 of 1000 samples"}"#,
        );
        assert_eq!(HealthLine::from(&health).to_json(), expected);
    }
}

//! The functional end of life: faults that are harmless one by one end a life together, before any of them is worn out.

use ema_identify::calibration::{MonitorForm, TypeCalibration};
use ema_models::FaultVector;
use ema_wire::ActuatorId;
use hmd_core::config::{Config, Specification};
use hmd_core::frame::RawFrame;
use hmd_core::functional_check::{CHECK_LANES, UnmetRequirement, unmet_requirements};
use hmd_lab::simulate::{EPOCH_NS, traffic};

use crate::bench::{EXACT, unit, watch_all_with};

/// A healthy `bench` actuator makes its step against 914 Nm; with three faults of 0.5 against 516 Nm.
const STALL_LOAD_NM: f64 = 600.0;

/// Sorties, and the hours from one to the next.
const SORTIES: u64 = 12;
const HOURS_BETWEEN: u64 = 100;

/// Friction and two shorted phases grow together, all at one pace, far from the damage of 0.8 that ends a life.
fn worn(damage: f64) -> FaultVector {
    FaultVector {
        friction: damage,
        short_a: damage,
        short_b: damage,
        ..FaultVector::NOMINAL
    }
}

fn damage_after(hours: f64) -> f64 {
    2.5e-4 * hours
}

fn sortie(n: u64) -> Vec<RawFrame> {
    let hours = n * HOURS_BETWEEN;
    let scenario = unit(worn(damage_after(hours as f64)), 100 + n);
    let actuator = ActuatorId::new(0).expect("0 to 15");
    traffic(&scenario, actuator, EPOCH_NS + hours * 3_600_000_000_000).collect()
}

/// Hours after which the true faults make the monitor miss the requirement.
fn true_end_h(misses: impl Fn(&FaultVector) -> bool) -> f64 {
    (0..400)
        .map(|n| 10.0 * f64::from(n))
        .find(|hours| misses(&worn(damage_after(*hours))))
        .expect("an end")
}

#[test]
fn faults_that_are_harmless_one_by_one_reach_the_end_of_life_together() {
    let form = MonitorForm::ThreePhase;
    let calibration = TypeCalibration::built_in("bench", form)
        .expect("it is shipped")
        .coefficients();
    let params = unit(FaultVector::NOMINAL, 1).unit;
    let spec = Specification {
        stall_load_nm: STALL_LOAD_NM,
        ..Specification::default()
    };
    let missed = |fault: &FaultVector| unmet_requirements(&params, &calibration, &spec, &[*fault; CHECK_LANES])[0];
    let end_h = true_end_h(|fault| missed(fault).is_some());
    let at_end = damage_after(end_h);
    assert!(at_end < 0.5, "all damages are far from their own ends: {at_end}");
    let nominal = FaultVector::NOMINAL;
    for alone in [
        FaultVector {
            friction: at_end,
            ..nominal
        },
        FaultVector {
            short_a: at_end,
            ..nominal
        },
        FaultVector {
            short_b: at_end,
            ..nominal
        },
    ] {
        assert_eq!(missed(&alone), None, "{alone:?}");
    }
    assert_eq!(missed(&worn(at_end)), Some(UnmetRequirement::Stall));

    let text =
        format!("{EXACT}[rul]\nhours = \"elapsed\"\n[type.bench.specification]\nstall_load_nm = {STALL_LOAD_NM}\n");
    let config = Config::from_toml_str(&text, "test").expect("a configuration");
    let outcome = watch_all_with(config, (0..SORTIES).map(sortie));
    let last = &outcome.windows.last().expect("windows").rul;
    assert_eq!(last.governed_by, "stall", "{last:?}");
    let (now, p50) = (last.operating_h.expect("hours"), last.rul_p50_h.expect("a forecast"));
    assert!(
        (now + p50 - end_h).abs() < 0.1 * end_h,
        "{now} + {p50} h, expected {end_h} h"
    );
    // Each fault alone would last until its damage is 0.8.
    for alone in [last.friction_p50_h, last.short_a_p50_h, last.short_b_p50_h] {
        assert!(now + alone.expect("a trend") > 1.3 * end_h, "{alone:?}");
    }
}

//! No damage heals: one that vanishes without a recorded repair is told.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use ema_models::{FaultId, FaultVector};
use hmd_core::assess::{AssessedWindow, Assessor, Models};
use hmd_core::history::{Event, EventKind, Events, FELL};

use super::sensor_health::{config, windows};

/// Four windows with a worn gear and three without, the event recorded between them if there is one.
fn assessed(replaced: bool) -> Vec<AssessedWindow> {
    let config = config();
    let worn = FaultVector::from_array([0.0, 0.6, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5]);
    let mut jobs = windows(&config, 4, |_| 0.0, worn);
    let mut sound = windows(&config, 7, |_| 0.0, FaultVector::NOMINAL).split_off(4);
    let between_ns = sound[0].window.t_start_ns - 1;
    jobs.append(&mut sound);
    let mut assessor = Assessor::new(config.clone(), Models::without_files(&config).unwrap(), 1);
    if replaced {
        let list = vec![Event {
            t_ns: between_ns,
            actuator: "ema0".to_owned(),
            event: EventKind::Reset,
            part: None,
            note: None,
        }];
        assessor.histories().set_events(Events {
            list,
            ..Events::default()
        });
    }
    jobs.into_iter().map(|job| assessor.assess(job).unwrap()).collect()
}

#[test]
fn a_damage_that_vanishes_without_a_recorded_repair_is_told_once() {
    for replaced in [false, true] {
        let assessed = assessed(replaced);
        let before = &assessed[3].health;
        let damage = before.damages()[FaultId::Backlash.index()];
        assert!(damage.is_some_and(|damage| damage > 0.4), "{before:?}");
        let told: Vec<usize> = (0..assessed.len())
            .filter(|n| assessed[*n].health.reason.contains(FELL))
            .collect();
        let expected: &[usize] = if replaced { &[] } else { &[4] };
        assert_eq!(told, expected, "{:?}", assessed[4].health.reason);
        if let [n] = expected {
            let window = &assessed[*n];
            assert_eq!(window.health.status, "degraded");
            assert!(window.health.reason.contains("(backlash "), "{}", window.health.reason);
            let is_news = |text: &str| text.starts_with(FELL);
            assert!(window.news.iter().any(|news| news.for_the_worse && is_news(&news.text)));
        }
    }
}

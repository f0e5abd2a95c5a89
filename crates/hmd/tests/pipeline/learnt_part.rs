//! A part of a learnt unit is replaced: what is known of the other parts stays, and is never learnt as health.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::sync::Arc;

use ema_models::FaultVector;
use hmd_core::assess::{AssessedWindow, Assessor, Models};
use hmd_core::config::Config;
use hmd_core::deadline::TimeLimit;
use hmd_core::history::{Event, EventKind, Events, ReplacedPart};
use hmd_core::learning::Learner;
use hmd_core::outbox::WindowJob;

use super::sensor_health::windows;

struct Run {
    assessor: Assessor,
    learner: Learner,
    events: Vec<Event>,
    next: u64,
}

impl Run {
    fn take(&mut self, mut job: WindowJob) -> AssessedWindow {
        job.window.number = self.next;
        job.window.t_start_ns = t_ns(self.next);
        self.next += 1;
        let assessed = self
            .learner
            .assess(&mut self.assessor, job, &TimeLimit::none())
            .unwrap();
        self.learner.commission_complete(&mut self.assessor).unwrap();
        assessed
    }

    /// Before the next window.
    fn replace(&mut self, part: ReplacedPart) {
        self.events.push(Event {
            t_ns: t_ns(self.next) - 1,
            actuator: "ema0".to_owned(),
            event: EventKind::Reset,
            part: Some(part),
            note: None,
        });
        self.assessor.histories().set_events(Events {
            list: self.events.clone(),
            ..Events::default()
        });
    }
}

fn t_ns(number: u64) -> u64 {
    1_700_000_000_000_000_000 + 3_600_000_000_000 * number
}

#[test]
fn a_fault_of_another_part_stays_known_and_is_not_learnt() {
    let text = "[[actuator]]\nid = 0\nlearn_windows = 5\nlearn_folder = \"units\"\n[type.bench]\ntolerances = \"usual\"\n\
        [type.bench.sensors]\nsample_rate_hz = 400\n[rul]\nhours = \"elapsed\"";
    let config = Arc::new(Config::from_toml_str(text, "hmd.toml").unwrap());
    let actuator = &config.actuators()[0];
    let sound = windows(&config, 6, |_| 0.0, FaultVector::NOMINAL);
    for (short_a, state) in [(0.22, "watch"), (0.7, "critical")] {
        let worn = FaultVector::from_array([0.0, 0.0, short_a, 0.0, 0.0, 0.0, 0.5, 0.5]);
        let worn = windows(&config, 6, |_| 0.0, worn);
        let mut run = Run {
            assessor: Assessor::new(config.clone(), Models::without_files(&config).unwrap(), 1),
            learner: Learner::new(config.clone(), 1),
            events: Vec::new(),
            next: 0,
        };
        for job in &sound {
            run.take(job.clone());
        }
        assert!(run.assessor.knows_unit(actuator));
        assert_eq!(run.take(worn[0].clone()).health.health, state);
        run.learner.take_notices();
        run.replace(ReplacedPart::Gearbox);
        let why = format!("not learnt with short_a at {state}: repair it and record that (hmd event --reset ema0");
        // Nor does it seem to heal.
        for job in worn.iter().chain(&sound[..2]) {
            let health = run.take(job.clone()).health;
            assert_eq!(
                (&*health.health, &*health.faults),
                (state, "short_a"),
                "{}",
                health.reason
            );
            assert!(health.reason.contains(&why), "{}", health.reason);
        }
        assert!(!run.assessor.knows_unit(actuator));
        let notices = run.learner.take_notices();
        assert!(notices.len() == 1 && notices[0].contains(&why), "{notices:?}");
        run.replace(ReplacedPart::Motor);
        for (n, job) in sound[..5].iter().enumerate() {
            let health = run.take(job.clone()).health;
            assert_eq!(health.health, "unknown");
            assert!(
                health.reason.contains(&format!("learning, {} of 5", n + 1)),
                "{}",
                health.reason
            );
        }
        assert!(run.assessor.knows_unit(actuator));
        assert_eq!(run.take(sound[5].clone()).health.health, "nominal");
    }
}

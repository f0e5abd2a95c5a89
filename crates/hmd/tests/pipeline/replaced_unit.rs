//! A calibration that is older than a recorded replacement is of another unit, and judges none.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use ema_models::FaultVector;
use hmd_core::assess::{Assessor, Models};
use hmd_core::commissioning::calibrate_unit;
use hmd_core::history::{Event, EventKind, Events, ReplacedPart};

use super::sensor_health::{config, windows};

#[test]
fn a_calibration_older_than_a_replacement_is_not_used_and_that_is_said() {
    let config = config();
    let actuator = &config.actuators()[0];
    let assessor = || Assessor::new(config.clone(), Models::without_files(&config).unwrap(), 1);
    let mut healthy = windows(&config, 9, |_| 0.0, FaultVector::NOMINAL);
    let last = healthy.pop().unwrap();
    let newest_ns = healthy[7].window.t_start_ns;
    let unit = calibrate_unit(&assessor(), config.health().levels(), &mut healthy, 1, &|_| ())
        .unwrap()
        .calibration;
    let now_ns = last.window.t_start_ns;
    for (t_ns, part, is_used) in [
        (newest_ns, None, true),
        (now_ns + 1, None, true),
        (now_ns, None, false),
        (newest_ns + 1, Some(ReplacedPart::Motor), false),
        (newest_ns + 1, Some(ReplacedPart::Gearbox), false),
        (newest_ns + 1, Some(ReplacedPart::Controller), false),
    ] {
        let mut assessor = assessor();
        assessor.set_unit("ema0", unit.clone());
        let event = Event {
            t_ns,
            actuator: "ema0".to_owned(),
            event: EventKind::Reset,
            part,
            note: None,
        };
        assessor.histories().set_events(Events {
            list: vec![event],
            ..Events::default()
        });
        for _ in 0..2 {
            let health = assessor.assess(last.clone()).unwrap().health;
            let reason = "its calibration is older than a recorded replacement, and not used";
            assert_eq!(health.reason.contains(reason), !is_used, "{}", health.reason);
        }
        assert_eq!(assessor.knows_unit(actuator), is_used, "{t_ns} {part:?}");
        let told =
            "ema0: its calibration is older than a replacement that was recorded, and not used: calibrate it again";
        let notices = assessor.histories().take_notices();
        assert_eq!(notices.contains(&told.to_owned()), !is_used, "{notices:?}");
    }
}

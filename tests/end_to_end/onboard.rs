//! Identification as it runs on the controller, here: against the host's own.

#[path = "../target_cases.rs"]
mod target_cases;

use ema_identify::RecordedWindow;
use ema_models::{ComparedSample, FaultVector, rss_pct};
use target_cases::worn;

#[test]
fn the_controller_reads_its_words_as_the_host_does() {
    let case = worn();
    let host = case.prepared.recording();
    let window = RecordedWindow::new(&case.actuator.params, &case.samples, case.rest).expect("a window");
    assert_eq!(*window.initial(), host.initial);
    assert_eq!(window.compared().collect::<Vec<ComparedSample>>(), host.samples);
}

#[test]
fn the_controller_finds_the_bits_that_the_host_finds() {
    let mut case = worn();
    let found = case.on_the_controller();
    assert_eq!(found, case.on_the_host());
    let truth = FaultVector {
        friction: 0.4,
        backlash: 0.1,
        short_b: 0.15,
        ..FaultVector::NOMINAL
    };
    let wrong = rss_pct(&found.fault, &truth);
    // Seen: 0.35 %.
    assert!(wrong < 0.8, "{wrong} % from the truth: {found:?}");

    // Two starts, and one motor among many.
    case.conditions.load_torque = None;
    case.actuator.motor = hmd_core::assess::motor_within(&ema_models::Tolerances::MOTOR_ONLY);
    case.identifier.motor = case.actuator.motor;
    assert_eq!(case.on_the_controller(), case.on_the_host(), "unmeasured load");
}

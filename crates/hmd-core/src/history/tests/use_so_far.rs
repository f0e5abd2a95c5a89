//! Hours, cycles and work.

use super::*;

#[test]
fn operating_hours_follow_the_frames_and_dropped_windows_are_cycles() {
    let config = config("");
    let mut history = UnitHistory::new(&config, None).expect("levels");
    let mut used = |number, operating_s| {
        let job = job(&config, number, 0.0, operating_s);
        history.update(&job, &evidence(None, &Fit::default()), &config).used
    };
    assert!((used(0, 3600.0).hours - 1.0).abs() < 1e-12);
    // Two windows were dropped.
    let second = used(3, 7200.0);
    assert!((second.hours - 2.0).abs() < 1e-12 && (second.cycles - 4.0).abs() < 1e-12);
    // The source began anew.
    let third = used(0, 1800.0);
    assert!((third.hours - 2.5).abs() < 1e-12 && (third.cycles - 5.0).abs() < 1e-12);
}

#[test]
fn work_is_measured_and_others_count_as_the_mean() {
    let config = config("");
    let mut history = UnitHistory::new(&config, None).expect("levels");
    let fit = Fit {
        i_q_measured: vec![2.0; 1000],
        omega_measured: vec![-50.0; 1000],
        ..Fit::default()
    };
    // 1.5 × 0.9 Nm/A × 2 A × 50 rad/s for half a second.
    let expected = 1.5 * ActuatorParams::bench().motor.k * 2.0 * 50.0 * 0.5;
    let first = history
        .update(&job(&config, 0, 0.0, 1.0), &evidence(None, &fit), &config)
        .used
        .work_j;
    assert!((first / expected - 1.0).abs() < 1e-6, "{first} J");
    let second = history
        .update(&job(&config, 1, 0.0, 2.0), &evidence(None, &Fit::default()), &config)
        .used
        .work_j;
    assert!((second / expected - 2.0).abs() < 1e-6, "{second} J");
}

#[test]
fn elapsed_hours_do_not_jump_with_the_clock() {
    let config = config("hours = \"elapsed\"");
    let mut history = UnitHistory::new(&config, None).expect("levels");
    let mut hours = |number, t_start_ns| {
        let mut job = job(&config, number, 0.0, 0.0);
        job.window.t_start_ns = t_start_ns;
        history
            .update(&job, &evidence(None, &Fit::default()), &config)
            .used
            .hours
    };
    let begun = 1_700_000_000_000_000_000;
    // A clock without a battery, which is set after the second window.
    let shown = [
        3 * HOUR_NS,
        4 * HOUR_NS,
        begun,
        begun + HOUR_NS,
        5 * HOUR_NS,
        begun + 3 * HOUR_NS,
    ];
    for ((number, t_start_ns), expected) in (0..).zip(shown).zip([0.0, 1.0, 1.0, 2.0, 2.0, 4.0]) {
        let hours = hours(number, t_start_ns);
        assert!((hours - expected).abs() < 1e-9, "window {number}: {hours} h");
    }
}

#[test]
fn a_stamp_far_in_the_future_does_not_end_the_counting_of_elapsed_hours() {
    let config = config("hours = \"elapsed\"");
    let window = |hours: f64| job(&config, 0, hours, 0.0);
    let used = |histories: &mut HistoryStore, hours: f64| {
        let job = window(hours);
        let history = histories
            .history_at(&job.actuator, job.window.t_start_ns)
            .expect("levels");
        history
            .update(&job, &evidence(None, &Fit::default()), &config)
            .used
            .hours
    };
    let far = 700_000.0;
    let mut histories = HistoryStore::new(config.clone());
    let found = [0.0, far, 10.0, 12.0, 11.0, 13.0].map(|hours| used(&mut histories, hours) - far);
    let expected = [-far, 0.0, 0.0, 2.0, 2.0, 3.0];
    let near = |found: &[f64], expected: &[f64]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near(&found, &expected), "{found:?}");
    let notices = histories.take_notices();
    assert_eq!(notices.len(), 1, "{notices:?}");
    assert!(
        notices[0].starts_with("ema0: the clock is 699990 h behind"),
        "{notices:?}"
    );

    // A new unit's hours count from its event on, whatever stamp was before.
    let mut histories = HistoryStore::new(config.clone());
    used(&mut histories, 0.0);
    used(&mut histories, far);
    histories.set_events(events(&[reset(window(20.0).window.t_start_ns, None)]));
    let found = [26.0, 27.0].map(|hours| used(&mut histories, hours));
    assert!(near(&found, &[6.0, 7.0]), "{found:?}");
}

#[test]
fn hours_of_another_kind_begin_anew_and_are_told() {
    let elapsed = config("hours = \"elapsed\"");
    let mut histories = HistoryStore::new(elapsed.clone());
    wear_out(&mut histories, &elapsed, 0, 60);
    for (hours, expected) in [("elapsed", 590.0), ("operating", 0.0)] {
        let config = config(&format!("hours = {hours:?}"));
        let mut again = HistoryStore::new(config.clone());
        again.restore("ema0", stored(&histories));
        let actuator = config.actuator_named("ema0").expect("watched");
        let history = again.history_at(actuator, 0).expect("levels");
        assert!(
            (history.used.hours - expected).abs() < 1e-6,
            "{hours}: {:?}",
            history.used
        );
        let is_kept = history.prognosis.forecast(1.0).actuator.is_ok();
        let notices = again.take_notices();
        assert_eq!(
            (is_kept, notices.len()),
            (hours == "elapsed", usize::from(hours != "elapsed"))
        );
    }
    // Older files did not say of which kind they were.
    let mut older = serde_json::to_value(stored(&histories)).expect("numbers");
    older.as_object_mut().expect("fields").remove("hours_of");
    let older: UnitHistory = serde_json::from_value(older).expect("a history");
    let resumed = older.resumed(&config(""), None).expect("levels");
    assert!(resumed.used.hours > 500.0 && resumed.notices.is_empty());
}

#[test]
fn windows_dropped_at_the_start_of_a_run_are_cycles() {
    let config = config("");
    let mut histories = HistoryStore::new(config.clone());
    let cycles = |histories: &mut HistoryStore, number| {
        let job = job(&config, number, 0.0, 0.0);
        let history = histories.history_at(&job.actuator, 0).expect("levels");
        let used = history.update(&job, &evidence(None, &Fit::default()), &config).used;
        used.cycles.round() as u64
    };
    let first = [0, 1, 3].map(|number| cycles(&mut histories, number));
    assert_eq!(first, [1, 2, 4]);
    histories.begin_run();
    let second = [1, 2].map(|number| cycles(&mut histories, number));
    assert_eq!(second, [6, 7], "the first was dropped");
    // The first of all, too.
    assert_eq!(cycles(&mut HistoryStore::new(config.clone()), 2), 3);
}

#[test]
fn operation_after_the_last_window_of_a_run_counts_also_in_a_run_without_any() {
    let config = config("");
    let mut histories = HistoryStore::new(config.clone());
    let used = |histories: &mut HistoryStore, operating_s: f64| {
        let job = job(&config, 0, 0.0, operating_s);
        let history = histories.history_at(&job.actuator, 0).expect("levels");
        let used = history.update(&job, &evidence(None, &Fit::default()), &config).used;
        used.hours
    };
    let end = |histories: &mut HistoryStore, operating_s: f64| {
        histories.end_run([("ema0", operating_s)].into_iter()).expect("levels");
        histories.begin_run();
    };
    end(&mut histories, 7200.0);
    assert!(
        histories.get("ema0").is_none(),
        "a history starts with the first window"
    );
    used(&mut histories, 3600.0);
    end(&mut histories, 10_800.0);
    // As a replay, and as a daemon that is started again.
    let mut again = HistoryStore::new(config.clone());
    again.restore("ema0", stored(&histories));
    for mut histories in [histories, again] {
        end(&mut histories, 1800.0);
        let hours = used(&mut histories, 3600.0);
        assert!((hours - 4.5).abs() < 1e-9, "{hours}");
    }
}

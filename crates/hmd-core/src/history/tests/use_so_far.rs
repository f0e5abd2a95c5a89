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
    let found = [0.0, far, 10.0, 12.0, 11.0, 13.0].map(|hours| used(&mut histories, hours));
    let expected = [0.0, far, 10.0, 12.0, 12.0, 13.0];
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

/// Windows every two days, of which two have a wrong clock: forecasts and hours are those of the right one.
#[test]
fn a_clock_that_is_wrong_for_two_windows_moves_no_forecast() {
    let config = config("hours = \"elapsed\"");
    let ends = |wrong_by_h: f64| {
        let mut histories = HistoryStore::new(config.clone());
        let mut end = None;
        for n in 0..20_u32 {
            let hours = 48.0 * f64::from(n);
            let shown = if n == 10 || n == 11 { hours + wrong_by_h } else { hours };
            let job = job(&config, n.into(), shown, 0.0);
            let history = histories
                .history_at(&job.actuator, job.window.t_start_ns)
                .expect("levels");
            let damage = friction(0.024 * f64::from(n));
            let told = history.update(&job, &evidence(Some(&damage), &Fit::default()), &config);
            end = Some((told.used.hours, told.forecast.actuator));
        }
        let (hours, left) = end.expect("windows");
        (hours, left.expect("a trend").hours.p50)
    };
    let (hours, left) = ends(0.0);
    assert!((hours - 912.0).abs() < 1e-6);
    for wrong_by_h in [-87_600.0, -2400.0, 2400.0, 43_800.0] {
        let (found_h, found) = ends(wrong_by_h);
        assert!((found_h - hours).abs() < 1.0, "{wrong_by_h}: {found_h} h");
        assert!((found / left - 1.0).abs() < 0.1, "{wrong_by_h}: {found} of {left} h");
    }
}

/// A pause of months between logs, and later a clock that is set back for good.
#[test]
fn a_long_pause_counts_and_is_not_taken_back_later() {
    let config = config("hours = \"elapsed\"");
    let mut history = UnitHistory::new(&config, None).expect("levels");
    let mut used = |hours: f64| {
        let job = job(&config, 0, hours, 0.0);
        let told = history.update(&job, &evidence(None, &Fit::default()), &config);
        told.used.hours
    };
    used(0.0);
    for n in 0..40 {
        assert!((used(4000.0 + f64::from(n)) - 4000.0 - f64::from(n)).abs() < 1e-6);
    }
    assert!((used(3000.0) - 4039.0).abs() < 1e-6);
    assert!((used(3010.0) - 4049.0).abs() < 1e-6);
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
fn windows_dropped_at_the_end_of_a_run_are_cycles() {
    let config = config("");
    let mut histories = HistoryStore::new(config.clone());
    let cycles = |histories: &mut HistoryStore, number| {
        let job = job(&config, number, 0.0, 0.0);
        let history = histories.history_at(&job.actuator, 0).expect("levels");
        let fit = Fit {
            i_q_measured: vec![2.0; 1000],
            omega_measured: vec![-50.0; 1000],
            ..Fit::default()
        };
        let used = history.update(&job, &evidence(None, &fit), &config).used;
        (used.cycles.round() as u64, used.work_j / used.cycles)
    };
    let end = |histories: &mut HistoryStore, next_window: u64| {
        let end = RunEnd {
            next_window,
            ..RunEnd::default()
        };
        histories.end_run([("ema0", end)].into_iter()).expect("levels");
        histories.begin_run();
    };
    let (first, work_j) = cycles(&mut histories, 0);
    assert_eq!(first, 1);
    // Three of four were dropped; then a run whose two were dropped, and one without any.
    [4, 2, 0]
        .into_iter()
        .for_each(|next_window| end(&mut histories, next_window));
    let mut again = HistoryStore::new(config.clone());
    again.restore("ema0", stored(&histories));
    for mut histories in [histories, again] {
        let (all, mean_j) = cycles(&mut histories, 0);
        assert_eq!(all, 7);
        assert!((mean_j / work_j - 1.0).abs() < 1e-9, "{mean_j} {work_j}");
    }
}

/// Operating hours pass evenly between windows of a run; before the first window of one it is not known when it began.
#[test]
fn a_new_unit_inherits_neither_hours_nor_cycles_of_the_one_before() {
    let config = config("");
    // The window before, whether a run began since, the event, the first window after it: hours and number, operating hours so far.
    for (between_runs, event_h, after, expected) in [
        (false, 99.0, (100.0, 11, 600.0), (1.0, 1.0)),
        (false, 50.0, (100.0, 11, 520.0), (10.0, 6.0)),
        (false, 100.0, (100.0, 11, 600.0), (0.0, 1.0)),
        (true, 50.0, (100.0, 3, 20.0), (20.0, 4.0)),
        (true, 99.0, (100.0, 3, 20.0), (1.0, 1.0)),
        // The clock was far ahead before.
        (false, -10.0, (-5.0, 11, 520.0), (5.0, 4.0)),
    ] {
        let mut histories = HistoryStore::new(config.clone());
        let used = |histories: &mut HistoryStore, (hours, number, operating_h): (f64, u64, f64)| {
            let mut job = job(&config, number, 0.0, 3600.0 * operating_h);
            job.window.t_start_ns = at(&config, hours);
            let history = histories
                .history_at(&job.actuator, job.window.t_start_ns)
                .expect("levels");
            let used = history.update(&job, &evidence(None, &Fit::default()), &config).used;
            (used.hours, used.cycles)
        };
        used(&mut histories, (0.0, 0, 500.0));
        if between_runs {
            histories.begin_run();
        }
        histories.set_events(events(&[reset(at(&config, event_h), None)]));
        let (hours, cycles) = used(&mut histories, after);
        assert!(
            (hours - expected.0).abs() < 1e-6 && (cycles - expected.1).abs() < 1e-9,
            "{event_h} {after:?}: {hours} {cycles}"
        );
    }
}

/// A time some hours after the epoch of these tests, also before it, UTC ns.
fn at(config: &Config, hours: f64) -> u64 {
    let epoch_ns = job(config, 0, 0.0, 0.0).window.t_start_ns;
    epoch_ns.saturating_add_signed((hours * HOUR_NS as f64) as i64)
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
        let end = RunEnd {
            operated_s: operating_s,
            ..RunEnd::default()
        };
        histories.end_run([("ema0", end)].into_iter()).expect("levels");
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

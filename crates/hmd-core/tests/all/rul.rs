//! The prognosis on histories that no suite draws: bad ones, long ones, and the ones that everybody understands.

use ema_models::FaultId;
use hmd_core::rul::{NoTrend, Odometer, Prognosis};

const SIGMA: f64 = 0.005;

/// Use after some hours of a steady life.
fn used(hours: f64) -> Odometer {
    Odometer {
        hours,
        cycles: 10.0 * hours,
        work_j: 500.0 * hours,
    }
}

/// A small error that repeats itself only after a long time.
fn error(n: usize) -> f64 {
    SIGMA * (2.0 * (n as f64 * 0.618_034).fract() - 1.0)
}

/// The prognosis after a history of one fault, (hours, damage).
fn after(history: impl IntoIterator<Item = (f64, f64)>, sigma: f64) -> Prognosis {
    let mut prognosis = Prognosis::new([0.8; FaultId::COUNT]);
    for (hours, damage) in history {
        let mut estimates = [None; FaultId::COUNT];
        estimates[0] = Some((damage, sigma));
        prognosis.update(used(hours), &estimates);
    }
    prognosis
}

fn steady(windows: usize) -> impl Iterator<Item = (f64, f64)> {
    (0..windows).map(|n| (10.0 * n as f64, 4e-3 * n as f64 + error(n)))
}

#[test]
fn a_steady_growth_ends_where_the_line_meets_the_threshold() {
    // 0.8 is reached after 200 windows of 10 h; a hundred have been seen.
    let forecast = after(steady(100), SIGMA).forecast(1000.0);
    let life = forecast.actuator.expect("a trend");
    assert!((life.hours.p50 - 1010.0).abs() < 30.0, "{:?}", life.hours);
    assert!(life.hours.p10 < life.hours.p50 && life.hours.p50 < life.hours.p90);
    assert!(
        life.hours.p90 - life.hours.p10 < 0.3 * life.hours.p50,
        "{:?}",
        life.hours
    );
    let cycles = life.cycles.expect("use is known");
    assert!((cycles.p50 - 10.0 * life.hours.p50).abs() < 1e-6);
    assert!(
        (0.2..0.8).contains(&life.fails_within_horizon),
        "{}",
        life.fails_within_horizon
    );
    assert_eq!(forecast.dominant, Some(FaultId::Friction));
    assert_eq!(forecast.faults[1], Err(NoTrend::TooFew { got: 0 }));
}

#[test]
fn an_exponential_growth_is_predicted_at_half_life() {
    let damage = |hours: f64| 0.8 * (4.0 * hours / 1000.0).exp_m1() / 4.0_f64.exp_m1();
    let history = (0..100).map(|n| (5.0 * n as f64, damage(5.0 * n as f64) + error(n)));
    let life = after(history, SIGMA).forecast(100.0).actuator.expect("a trend");
    assert!((life.hours.p50 - 505.0).abs() < 50.0, "{:?}", life.hours);
    assert!(life.fails_within_horizon < 0.01);
}

#[test]
fn wear_by_work_follows_the_use() {
    let mut prognosis = Prognosis::new([0.8; FaultId::COUNT]);
    let mut now = Odometer::default();
    for n in 0..120 {
        // The use doubles at a third of what is seen here.
        let per_hour = if n < 40 { 10.0 } else { 20.0 };
        now = Odometer {
            hours: now.hours + 5.0,
            cycles: now.cycles + 5.0 * per_hour,
            work_j: now.work_j + 5.0 * per_hour,
        };
        let mut estimates = [None; FaultId::COUNT];
        estimates[1] = Some((0.8 * now.work_j / 20_000.0 + error(n), SIGMA));
        prognosis.update(now, &estimates);
    }
    let life = prognosis.forecast(1.0).faults[1].expect("a trend");
    let truth = (20_000.0 - now.work_j) / 20.0;
    assert!(
        (life.hours.p50 / truth - 1.0).abs() < 0.05,
        "{:?} of {truth}",
        life.hours
    );
}

#[test]
fn several_faults_end_the_actuator_before_the_first_alone() {
    let mut prognosis = Prognosis::new([0.8; FaultId::COUNT]);
    for (n, (hours, damage)) in steady(60).enumerate() {
        let mut estimates = [None; FaultId::COUNT];
        estimates[0] = Some((damage, SIGMA));
        estimates[5] = Some((0.95 * damage + error(n + 7), SIGMA));
        prognosis.update(used(hours), &estimates);
    }
    let forecast = prognosis.forecast(1.0);
    let [first, second, all] =
        [forecast.faults[0], forecast.faults[5], forecast.actuator].map(|life| life.expect("a trend").hours.p50);
    assert!(all <= first && first < second, "{all} {first} {second}");
    assert_eq!(forecast.dominant, Some(FaultId::Friction));
}

/// Each alone ends the life out of reach, and the first of seven within.
#[test]
fn faults_whose_median_is_out_of_reach_count_for_the_actuator() {
    let mut alone = Prognosis::new([0.8; FaultId::COUNT]);
    let mut all = alone.clone();
    for n in 0..60 {
        let slow = |fault| 5e-4 * n as f64 + 2.0 * error(n + 31 * fault);
        let mut first = [None; FaultId::COUNT];
        first[0] = Some((slow(0), SIGMA));
        alone.update(used(10.0 * n as f64), &first);
        all.update(
            used(10.0 * n as f64),
            &std::array::from_fn(|fault| Some((slow(fault), SIGMA))),
        );
    }
    let (alone, all) = (alone.forecast(1e4), all.forecast(1e4));
    assert!(matches!(alone.actuator, Err(NoTrend::TooFar { .. })), "{alone:?}");
    assert!(all.faults.iter().all(Result::is_err), "{:?}", all.faults);
    let life = all.actuator.expect("one of them ends within reach");
    assert!(life.hours.p10 < life.hours.p50 && all.dominant.is_some(), "{all:?}");
}

#[test]
fn missing_and_unassessed_windows_and_outliers_do_little() {
    let clean = after(steady(100), SIGMA)
        .forecast(1.0)
        .actuator
        .expect("a trend")
        .hours
        .p50;
    let mut prognosis = Prognosis::new([0.8; FaultId::COUNT]);
    for (n, (hours, damage)) in steady(100).enumerate() {
        let mut estimates = [None; FaultId::COUNT];
        match n % 10 {
            3 => continue,
            7 => {}
            5 if n % 50 == 5 => estimates[0] = Some((0.9, SIGMA)),
            _ => estimates[0] = Some((damage, SIGMA)),
        }
        prognosis.update(used(hours), &estimates);
    }
    let spoilt = prognosis.forecast(1.0).actuator.expect("a trend").hours.p50;
    assert!((spoilt / clean - 1.0).abs() < 0.05, "{spoilt} and {clean}");
}

#[test]
fn an_outlier_at_the_very_beginning_is_no_beginning() {
    let history = std::iter::once((0.0, 0.7)).chain(steady(60).skip(1));
    let life = after(history, SIGMA).forecast(1.0).actuator.expect("a trend");
    assert!((life.hours.p50 - 1410.0).abs() < 60.0, "{:?}", life.hours);
}

#[test]
fn no_number_without_a_trend() {
    for (name, history) in [
        ("nothing", vec![]),
        ("one point", vec![(5.0, 0.3)]),
        ("five points", steady(5).collect()),
        (
            "healthy",
            (0..200).map(|n| (f64::from(n), error(n as usize).abs())).collect(),
        ),
        (
            "improves",
            (0..200).map(|n| (f64::from(n), 0.6 - 0.002 * f64::from(n))).collect(),
        ),
        (
            "stands still",
            (0..200).map(|n| (f64::from(n), 0.5 + error(n as usize))).collect(),
        ),
        (
            "repeats one time",
            (0..200).map(|n| (7.0, 0.1 + 0.001 * f64::from(n))).collect(),
        ),
        (
            "goes back in time",
            (0..200).map(|n| (200.0 - f64::from(n), 0.002 * f64::from(n))).collect(),
        ),
        ("is no number", (0..200).map(|n| (f64::from(n), f64::NAN)).collect()),
        (
            "has no time",
            (0..200).map(|n| (f64::NAN, 0.002 * f64::from(n))).collect(),
        ),
    ] {
        let forecast = after(history, SIGMA).forecast(100.0);
        let reason = forecast.actuator.expect_err(name);
        assert!(!reason.to_string().is_empty());
        assert_eq!(forecast.dominant, None, "{name}");
    }
}

#[test]
fn at_the_end_of_life_nothing_is_left_whatever_the_trend() {
    // A jump ends the trend; the first estimate beyond the end may be an outlier.
    let jumped = |windows: usize| {
        let before = (0..20).map(|n| (10.0 * n as f64, 0.1 + error(n)));
        after(
            before.chain((20..20 + windows).map(|n| (10.0 * n as f64, 0.9 + error(n)))),
            SIGMA,
        )
    };
    let forecast = jumped(1).forecast(100.0);
    assert!(forecast.actuator.is_err(), "{forecast:?}");
    let forecast = jumped(5).forecast(100.0);
    let life = forecast.actuator.expect("an end");
    assert!(
        life.hours.p10.max(life.hours.p90) < f64::MIN_POSITIVE,
        "{:?}",
        life.hours
    );
    assert!(life.fails_within_horizon >= 1.0);
    assert_eq!(forecast.dominant, Some(FaultId::Friction));
    assert_eq!(forecast.faults[0], Ok(life));
}

#[test]
fn what_comes_twice_or_late_changes_nothing() {
    let clean = after(steady(60), SIGMA).forecast(1.0);
    let (mut twice, mut late) = (Vec::new(), Vec::new());
    for (n, estimate) in steady(60).enumerate() {
        twice.extend([estimate, estimate]);
        late.push(estimate);
        if n > 20 {
            // What an older window says comes once more, with another damage.
            late.push((10.0 * (n as f64 - 15.0), 0.7));
        }
    }
    assert_eq!(after(twice, SIGMA).forecast(1.0), clean);
    assert_eq!(after(late, SIGMA).forecast(1.0), clean);
}

#[test]
fn a_jump_begins_a_new_trend_and_is_reported() {
    let jumped = || steady(50).chain((50..).map(|n| (10.0 * f64::from(n), 0.5 + error(n as usize))));
    // A single estimate is rather an outlier; of what two begin the trend before it tells nothing.
    let outlier = after(jumped().take(51), SIGMA).forecast(1.0).actuator;
    assert!(outlier.is_ok(), "{outlier:?}");
    for got in 2..=3 {
        let reason = after(jumped().take(50 + got), SIGMA).forecast(1.0).actuator;
        assert_eq!(reason, Err(NoTrend::AboveTrend { got: got as u32 }));
    }
    let prognosis = after(jumped().take(55), SIGMA);
    let reason = prognosis.forecast(1.0).actuator.expect_err("a new trend");
    assert!(matches!(reason, NoTrend::Jumped { .. }), "{reason}");
    // The level it has jumped to does not grow.
    let reason = after(jumped().take(100), SIGMA)
        .forecast(1.0)
        .actuator
        .expect_err("no growth");
    assert_eq!(reason, NoTrend::NoGrowth);
}

#[test]
fn scatter_beyond_its_sigma_widens_the_interval() {
    let scattered = |scale: f64| (0..100).map(move |n| (10.0 * n as f64, 0.05 + 4e-3 * n as f64 + scale * error(n)));
    let width = |scale: f64| {
        let life = after(scattered(scale), SIGMA).forecast(1.0).actuator.expect("a trend");
        (life.hours.p90 - life.hours.p10, life.hours.p50)
    };
    let (honest, _) = width(1.0);
    let (wide, median) = width(6.0);
    assert!(wide > 2.0 * honest, "{wide} and {honest}");
    assert!((median - 960.0).abs() < 150.0, "{median}");
    // A sigma of nothing is not believed.
    let life = after(scattered(1.0), 0.0).forecast(1.0).actuator.expect("a trend");
    assert!(life.hours.p90 - life.hours.p10 > 1.0);
}

#[test]
fn numbers_at_the_edge_of_the_machine_neither_panic_nor_promise() {
    let edges = [
        0.0,
        -1.0,
        1e-300,
        1e-9,
        1.0,
        1e9,
        1e300,
        f64::MAX,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NAN,
    ];
    for scale in edges {
        for sigma in edges {
            for damage in edges {
                let mut prognosis = after((0..12).map(|n| (scale * f64::from(n), damage * f64::from(n))), sigma);
                prognosis.update(
                    Odometer {
                        hours: scale,
                        cycles: damage,
                        work_j: sigma,
                    },
                    &[Some((damage, sigma)); FaultId::COUNT],
                );
                if let Ok(life) = prognosis.forecast(scale).actuator {
                    let q = life.hours;
                    assert!(
                        q.p10 <= q.p50 && q.p50 <= q.p90 && q.p90.is_finite(),
                        "{scale} {sigma} {damage}: {q:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn memory_is_bounded_over_a_life_of_any_length() {
    let mut prognosis = Prognosis::new([0.8; FaultId::COUNT]);
    let mut largest = 0;
    for n in 0..20_000_u32 {
        // From seconds to decades, all faults growing.
        let hours = 1e-3 * f64::from(n + 1).powf(2.0);
        prognosis.update(
            used(hours),
            &[Some((0.5 * f64::from(n) / 20_000.0, SIGMA)); FaultId::COUNT],
        );
        if n % 1000 == 999 {
            largest = largest.max(serde_json::to_vec(&prognosis).map_or(usize::MAX, |state| state.len()));
        }
    }
    assert!(largest < 400_000, "{largest} bytes");
}

/// Windows of eight days until day 98, then `later` every third day from day 100 on, with a small error: (hours, damage).
fn step(windows: usize, before: impl Fn(f64) -> f64, later: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
    let before = (0..windows)
        .map(|n| 98.0 - 8.0 * (windows - 1 - n) as f64)
        .map(|day| (24.0 * day, before(day)));
    let later = (0..12).map(|n| (24.0 * (100.0 + 3.0 * f64::from(n)), later(3.0 * f64::from(n))));
    let history = before.chain(later).enumerate();
    history.map(|(n, (hours, damage))| (hours, damage + error(n))).collect()
}

/// The laws of a young trend are open enough to follow a jump.
#[test]
fn a_jump_early_in_a_history_begins_a_new_trend_all_the_same() {
    // Worn, then repaired without an event; well, then damaged; each wears on.
    for windows in 2..=16 {
        let fall = step(windows, |day| 7e-3 * day, |days| 7e-3 * days);
        let rise = step(windows, |_| 0.0, |days| 0.2 + 7e-3 * days);
        for (name, history, truth) in [("fall", fall, 0.8), ("rise", rise, 0.6)] {
            let truth = 24.0 * (truth / 7e-3 - 33.0);
            let reason = after(history[..windows + 5].to_vec(), SIGMA).forecast(1.0).actuator;
            assert_eq!(
                reason,
                Err(NoTrend::Jumped { got: 5 }),
                "{name} after {windows} windows"
            );
            let life = after(history, SIGMA).forecast(1.0).actuator.expect(name);
            assert!(
                (life.hours.p50 / truth - 1.0).abs() < 0.2,
                "{name} after {windows} windows: {:?} of {truth}",
                life.hours
            );
        }
    }
}

#[test]
fn growth_that_is_fast_or_ever_faster_is_no_jump() {
    // Half as fast after three windows; and twenty times as fast after ten.
    let slower = (0..10).map(|n| {
        (
            10.0 * f64::from(n),
            0.03 * f64::from(n.min(3)) + 0.015 * f64::from((n - 3).max(0)),
        )
    });
    let faster = (0..16).map(|n| {
        (
            10.0 * f64::from(n),
            2e-3 * f64::from(n) + 4e-2 * f64::from((n - 10).max(0)),
        )
    });
    let exponential = (0..16).map(|n| (10.0 * f64::from(n), 1e-3 * (0.4 * f64::from(n)).exp()));
    for (name, history) in [
        ("slower", slower.collect::<Vec<_>>()),
        ("faster", faster.collect()),
        ("exponential", exponential.collect()),
    ] {
        for windows in 6..=history.len() {
            let seen = history[..windows].iter().enumerate();
            let forecast = after(seen.map(|(n, (hours, damage))| (*hours, damage + error(n))), SIGMA).forecast(1.0);
            let is_jump = matches!(forecast.faults[0], Err(NoTrend::Jumped { .. }));
            assert!(!is_jump, "{name} after {windows} windows");
        }
    }
}

/// Damage over hours.
type Damage = Box<dyn Fn(f64) -> f64>;

/// Growth that begins late, or whose speed changes: the trend is that of the growth there is now.
#[test]
fn a_change_of_growth_is_followed() {
    let late = |from: usize| move |h: f64| 5e-4 * (h - 40.0 * from as f64).max(0.0);
    let kinked = |from: usize, before: f64, now: f64| {
        move |h: f64| {
            let at = 40.0 * from as f64;
            before * h.min(at) + now * (h - at).max(0.0)
        }
    };
    for from in [3, 6, 10, 15, 20, 33] {
        let histories: [(&str, Damage, f64); 4] = [
            ("late", Box::new(late(from)), 5e-4),
            ("faster", Box::new(kinked(from, 1e-4, 5e-4)), 5e-4),
            ("slower", Box::new(kinked(from, 3e-4, 1e-4)), 1e-4),
            ("constant, then late", Box::new(move |h| 0.1 + late(from)(h)), 5e-4),
        ];
        for (name, damage, speed) in histories {
            for (windows, share) in [(from + 20, 0.3), (from + 30, 0.15)] {
                let hours = |n: usize| 40.0 * n as f64;
                let truth = (0.8 - damage(hours(windows - 1))) / speed;
                let history = (0..windows).map(|n| (hours(n), damage(hours(n)) + error(n)));
                let life = after(history, SIGMA).forecast(1.0).actuator.expect(name).hours;
                assert!(
                    (life.p50 / truth - 1.0).abs() < share,
                    "{name} from {from} after {windows}: {life:?} of {truth}"
                );
            }
        }
    }
}

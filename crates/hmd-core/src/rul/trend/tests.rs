//! Histories of estimates, what a trend makes of them, and what a file may not say.

use super::*;

#[test]
fn the_end_takes_two_estimates_in_a_row_from_the_first_on_and_stays_through_a_jump() {
    let ended = |damages: &[f64]| -> Vec<bool> {
        let mut trend = Trend::new(0.8);
        let ended = |(n, damage): (usize, &f64)| {
            let at = Odometer {
                hours: n as f64,
                cycles: n as f64,
                work_j: n as f64,
            };
            trend.update(at, *damage, 0.005);
            assert!(trend.is_possible(), "{trend:?}");
            trend.is_at_its_end()
        };
        damages.iter().enumerate().map(ended).collect()
    };
    assert_eq!(ended(&[0.0, 0.85, 0.0, 0.0]), [false; 4]);
    assert_eq!(ended(&[0.85, 0.86, 0.85, 0.86]), [false, true, true, true]);
    let mut jumps = vec![0.1; 12];
    jumps.extend([0.85; 12]);
    let found = ended(&jumps);
    assert_eq!(found.iter().position(|ended| *ended), Some(13), "{found:?}");
    assert!(found[13..].iter().all(|ended| *ended), "{found:?}");
}

/// A file of before the newest estimates were kept, in the middle of a jump: the estimate that ends it begins the new trend alone.
#[test]
fn a_jump_that_an_older_file_had_begun_goes_on_from_one_estimate() {
    let at = |n: u32| Odometer {
        hours: n.into(),
        cycles: n.into(),
        work_j: n.into(),
    };
    let mut trend = Trend::new(0.8);
    for n in 0..30 {
        trend.update(at(n), 0.1, 0.005);
    }
    for n in 30..33 {
        trend.update(at(n), 0.5, 0.005);
    }
    assert_eq!((trend.misfits, trend.jumps), (3, 0));
    let mut stored = serde_json::to_value(&trend).expect("numbers");
    stored.as_object_mut().expect("fields").remove("recent");
    let mut trend: Trend = serde_json::from_value(stored).expect("a trend");
    trend.update(at(33), 0.5, 0.005);
    assert!(trend.jumps == 1 && (trend.damage() - 0.5).abs() < 1e-12, "{trend:?}");
    for n in 34..40 {
        trend.update(at(n), 0.5, 0.005);
        assert!(trend.is_possible() && (trend.damage() - 0.5).abs() < 0.01, "{trend:?}");
    }
}

#[test]
fn a_stored_trend_that_cannot_have_come_about_is_refused() {
    type Change = fn(&mut Trend);
    let mut trend = Trend::new(0.8);
    for n in 0..40 {
        let at = Odometer {
            hours: f64::from(n),
            cycles: f64::from(n),
            work_j: f64::from(n),
        };
        trend.update(at, 1e-2 * f64::from(n), 0.005);
    }
    assert!(trend.is_possible() && !trend.later.lines.is_empty());
    let wrong: [(&str, Change); 13] = [
        ("one law", |trend| trend.laws.truncate(1)),
        ("too many laws", |trend| {
            let law = trend.laws[2].clone();
            trend.laws.resize(LAWS_MAX + 1, law);
        }),
        ("no straight law", |trend| trend.laws[1].rate = 1.0),
        ("a negative variance of damage", |trend| {
            trend.laws[0].covariance[0] = -1.0
        }),
        ("a negative variance of slope", |trend| {
            trend.laws[0].covariance[2] = -1.0
        }),
        ("a line that bends", |trend| trend.later.lines[0].rate = 1.0),
        ("a line of negative variance", |trend| {
            trend.later.lines[0].covariance[0] = -1.0
        }),
        ("a full start", |trend| trend.start = vec![Estimate::default(); START]),
        ("a rate beyond the machine", |trend| trend.slowest = Some(i32::MIN)),
        ("too many newest estimates", |trend| {
            trend.recent.push(Estimate::default())
        }),
        ("too many at the end", |trend| trend.misfits_at_end = u32::MAX),
        ("too many misfits", |trend| trend.misfits = JUMP_AFTER as u32),
        ("more estimates than any life has", |trend| trend.estimates = u64::MAX),
    ];
    for (name, change) in wrong {
        let mut changed = trend.clone();
        change(&mut changed);
        assert!(!changed.is_possible(), "{name}");
    }
}

/// The cost of an update is that of its laws.
#[test]
fn laws_are_few_on_every_time_scale() {
    for unit_h in [1e-6, 1.0, 1e4] {
        let mut trend = Trend::new(0.8);
        for n in 0..3000 {
            let hours = unit_h * f64::from(n) * if n < 1500 { 1.0 } else { 3.0 };
            let at = Odometer {
                hours,
                cycles: f64::from(n),
                work_j: f64::from(n),
            };
            trend.update(at, 2e-4 * f64::from(n), 0.005);
            assert!(
                trend.laws.len() <= 150,
                "{} laws after {n} of {unit_h} h",
                trend.laws.len()
            );
        }
        assert_eq!(trend.estimates, 3000);
        let sum: f64 = trend.weights().iter().sum();
        assert!((sum - 1.0).abs() < 1e-9, "{sum}");
    }
}

/// By their definition: the evidence at the first slope, what is known of rate × life beforehand, the mean of the laws for the lines.
#[test]
fn weights_are_evidence_times_what_is_known_beforehand() {
    let at = |hours: f64| Odometer {
        hours,
        cycles: hours,
        work_j: 50.0 * hours,
    };
    let law = |clock, rate, slope, log_evidence| Law {
        slope,
        log_evidence,
        ..Law::new(clock, rate, 0.3, 1e-6, 1e-9)
    };
    let mut trend = Trend::new(0.8);
    trend.laws_at = at(100.0);
    trend.laws = vec![
        law(Clock::Hours, 0.0, 2e-3, 0.0),
        law(Clock::Work, 0.0, 4e-5, -0.5),
        law(Clock::Hours, 0.02, 4e-3, -0.1),
        law(Clock::Hours, 0.09, 8e-3, -0.2),
    ];
    trend.later.lines = vec![law(Clock::Hours, 0.0, 3e-3, -0.3)];
    let exponential = |rate: f64, slope: f64| {
        let life = 100.0 + (1.0 + rate * 0.5 / slope).ln() / rate;
        let kappa = rate * life;
        let possible = if kappa > 8.0 { (8.0 - kappa).exp() } else { 1.0 };
        possible * (1.0 - (-kappa).exp()) * 1.04_f64.ln() / 8.0 / (slope * (-rate * 100.0).exp() * 100.0)
    };
    let expected = [
        1.0 / (2e-3 * 100.0),
        (-0.5_f64).exp() / (4e-5 * 5000.0),
        (-0.1_f64).exp() * exponential(0.02, 4e-3),
        (-0.2_f64).exp() * exponential(0.09, 8e-3),
    ];
    let evidence: f64 = [0.0_f64, -0.5, -0.1, -0.2].map(f64::exp).iter().sum();
    let line = (-0.3_f64).exp() * expected.iter().sum::<f64>() / evidence;
    let found = trend.relative_weights();
    for (found, expected) in found.iter().zip(expected.into_iter().chain([line])) {
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
    }
    assert_eq!(found.len(), 5);
}

#[test]
fn estimates_next_to_no_time_apart_have_a_slope_and_no_scatter() {
    let mut trend = Trend::new(0.8);
    for n in 0..40 {
        let hours = 0.01 * f64::from(n);
        let at = Odometer {
            hours,
            cycles: f64::from(n),
            work_j: f64::from(n),
        };
        trend.update(at, 0.1 + 0.01 * f64::from(n), 1e-3);
    }
    assert!((trend.laws[0].slope - 1.0).abs() < 0.01, "{}", trend.laws[0].slope);
    assert_eq!(trend.scatter.to_bits(), 1.0_f64.to_bits());
}

#[test]
fn the_scatter_is_that_of_the_estimates_and_outlives_a_jump() {
    let mut trend = Trend::new(0.8);
    let take = |trend: &mut Trend, n: u32, damage: f64| {
        let at = Odometer {
            hours: f64::from(n),
            cycles: f64::from(n),
            work_j: f64::from(n),
        };
        trend.update(at, damage, 2e-3);
    };
    // 2.5 times the stated deviation.
    for n in 0..200 {
        take(&mut trend, n, if n % 2 == 0 { 0.105 } else { 0.095 });
    }
    let before = trend.scatter;
    assert!((4.0..8.0).contains(&before), "{before}");
    for n in 200..210 {
        take(&mut trend, n, 0.6);
    }
    assert_eq!(trend.jumps, 1);
    assert!(trend.scatter > 0.5 * before, "{}", trend.scatter);
}

#[test]
fn what_is_no_number_is_no_estimate() {
    let mut trend = Trend::new(0.8);
    let at = Odometer {
        hours: 1.0,
        cycles: 1.0,
        work_j: 1.0,
    };
    for (damage, sigma) in [
        (f64::NAN, 0.1),
        (f64::INFINITY, 0.1),
        (0.1, f64::NAN),
        (0.1, f64::INFINITY),
        (0.1, -0.1),
    ] {
        trend.update(at, damage, sigma);
    }
    assert_eq!(trend, Trend::new(0.8));
}

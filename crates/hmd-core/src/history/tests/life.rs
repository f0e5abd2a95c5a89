//! The remaining life and its alarm: by damage, by function, by uncertain damage.

use std::cell::Cell;

use super::*;
use crate::functional_check::{CHECK_LANES, RequirementCheck, UnmetRequirement};
use crate::rul::NoTrend;

#[test]
fn what_is_left_can_be_worse_than_the_damage() {
    let config = config("hours = \"elapsed\"\nwarning_h = 10000\ncritical_h = 100");
    let assessments = wear_out(&mut HistoryStore::new(config.clone()), &config, 0, 20);
    assert_eq!(assessments[19].health.state, HealthState::Watch);
    assert_eq!(assessments[19].state, HealthState::Warning);
}

/// A requirement that is missed from a friction of 0.5 on, and how often it was checked.
fn useless(trials: &Cell<u32>) -> impl Fn(&[FaultVector; CHECK_LANES]) -> [Option<UnmetRequirement>; CHECK_LANES] {
    |faults| {
        trials.set(trials.get() + 1);
        faults.map(|fault| (fault.friction >= 0.5).then_some(UnmetRequirement::SlewRate))
    }
}

/// The assessment after a window with this friction, where a requirement is checked.
fn tried_after(
    history: &mut UnitHistory,
    job: &WindowJob,
    damage: f64,
    trial: &RequirementCheck<'_>,
    config: &Config,
) -> UnitAssessment {
    let fault = FaultVector {
        friction: damage,
        ..FaultVector::NOMINAL
    };
    let evidence = WindowEvidence {
        damage_evidence: Some(&friction(damage)),
        fault: Some(&fault),
        fit: &Fit::default(),
        unmet_requirement: Some(trial),
    };
    history.update(job, &evidence, config)
}

#[test]
fn an_unmet_requirement_ends_the_life_before_the_damage_does() {
    let config = config("hours = \"elapsed\"");
    let mut history = UnitHistory::new(&config, None).expect("levels");
    // Useless from a friction of 0.5 on: 625 h after the beginning instead of 1000 h.
    let trials = Cell::new(0);
    let useless = useless(&trials);
    for n in 0..70_u64 {
        let damage = 0.008 * n as f64;
        let assessments = tried_after(
            &mut history,
            &job(&config, n, 10.0 * n as f64, 0.0),
            damage,
            &useless,
            &config,
        );
        let Ok(left) = assessments.forecast.actuator else {
            continue;
        };
        let truth = (625.0 - 10.0 * n as f64).max(0.0);
        if n >= 20 {
            assert_eq!(
                assessments.limiting_criterion,
                LimitingCriterion::Function(UnmetRequirement::SlewRate)
            );
            assert!(
                (left.hours.p50 - truth).abs() <= 0.05 * truth + 5.0,
                "window {n}: {left:?}, truth {truth}"
            );
            assert!(left.hours.p10 <= left.hours.p50 && left.hours.p50 <= left.hours.p90);
            assert!(assessments.forecast.faults[0].expect("a trend").hours.p50 > left.hours.p50);
        }
    }
    assert!(trials.get() <= 2 * 70 / 3 + 2, "{} trials", trials.get());
    // A part that breaks ends the life with its second window: the first may be an outlier.
    let missed = LimitingCriterion::Function(UnmetRequirement::SlewRate);
    for damages in [
        &[0.9, 0.9, 0.9][..],
        &[0.0, 0.9, 0.9],
        &[0.9, 0.0, 0.0],
        &[0.0, 0.9, 0.0],
    ] {
        let mut fresh = UnitHistory::new(&config, None).expect("levels");
        let mut before = 0.0;
        for (n, damage) in (0..).zip(damages) {
            let assessments = tried_after(&mut fresh, &job(&config, n, n as f64, 0.0), *damage, &useless, &config);
            let is_missed = damage.min(before) > 0.5;
            let expected = if is_missed { missed } else { LimitingCriterion::Damage };
            assert_eq!(assessments.limiting_criterion, expected, "{damages:?}, window {n}");
            before = *damage;
        }
    }
}

#[test]
fn slow_wear_is_checked_every_eighth_window() {
    let config = config("hours = \"elapsed\"");
    let mut history = UnitHistory::new(&config, None).expect("levels");
    let trials = Cell::new(0);
    let useless = useless(&trials);
    for n in 0..240_u64 {
        let damage = 0.002 * n as f64;
        tried_after(
            &mut history,
            &job(&config, n, 10.0 * n as f64, 0.0),
            damage,
            &useless,
            &config,
        );
    }
    assert!(
        (40..=2 * 240 / 8 + 4).contains(&trials.get()),
        "{} trials",
        trials.get()
    );
}

/// As long as its state is unknown, a fault ends no life, whatever damage the windows find.
#[test]
fn an_uncertain_damage_ends_no_life_and_neither_raises_nor_clears_an_alarm_by_it() {
    let config = config("hours = \"elapsed\"\nwarning_h = 20\ncritical_h = 10");
    let uncertain = |damage: f64, sigma: f64| {
        let mut evidence = friction(damage);
        evidence.sigma.as_mut().expect("sigmas")[0] = sigma;
        evidence
    };
    let trials = Cell::new(0);
    let useless = useless(&trials);
    let assessed = |history: &mut UnitHistory, n: u64, evidence: &DamageEvidence| {
        let fault = FaultVector {
            friction: evidence.damage[0],
            ..FaultVector::NOMINAL
        };
        let evidence = WindowEvidence {
            damage_evidence: Some(evidence),
            fault: Some(&fault),
            fit: &Fit::default(),
            unmet_requirement: Some(&useless),
        };
        history.update(&job(&config, n, 10.0 * n as f64, 0.0), &evidence, &config)
    };
    for (damage, sigma) in [(1.0, 0.57), (0.54, 0.43), (0.85, 0.3), (0.7, 0.24)] {
        let mut history = UnitHistory::new(&config, None).expect("levels");
        for n in 0..12 {
            // That it grows is as uncertain.
            let found = uncertain(damage - 0.01 * (12 - n) as f64, sigma);
            let assessment = assessed(&mut history, n, &found);
            assert!(assessment.forecast.actuator.is_err(), "{damage} ± {sigma}, window {n}");
            assert_eq!(assessment.limiting_criterion, LimitingCriterion::Damage);
            assert_eq!(assessment.state, HealthState::Unknown);
        }
    }
    let mut history = UnitHistory::new(&config, None).expect("levels");
    for n in 0..4 {
        assessed(&mut history, n, &friction(0.9));
    }
    for n in 4..30 {
        let assessment = assessed(&mut history, n, &uncertain(0.2, 0.5));
        let left = assessment.forecast.actuator.expect("none left").hours;
        assert!(left.p50 <= 0.0, "{left:?}");
        assert_eq!(assessment.state, HealthState::Critical);
    }
}

#[test]
fn health_by_remaining_life_ends_with_the_growth() {
    let config = config("hours = \"elapsed\"\nwarning_h = 10000\ncritical_h = 10000");
    let mut histories = HistoryStore::new(config.clone());
    assert_eq!(
        wear_out(&mut histories, &config, 0, 20)[19].state,
        HealthState::Critical
    );
    let actuator = config.actuator_named("ema0").expect("watched");
    let mut states = Vec::new();
    // It was repaired, and nobody recorded it.
    for n in 20..40 {
        let history = histories.history_at(actuator, 0).expect("levels");
        let job = job(&config, n, 10.0 * n as f64, 0.0);
        let assessment = history.update(&job, &evidence(Some(&friction(0.0)), &Fit::default()), &config);
        states.push(assessment.state);
    }
    states.dedup();
    assert_eq!(states, [HealthState::Critical, HealthState::Nominal]);
}

#[test]
fn windows_that_were_not_assessed_raise_no_health() {
    let config = config("hours = \"elapsed\"\nwarning_h = 10000\n[health]\npersistence = 5");
    let mut histories = HistoryStore::new(config.clone());
    let worn = wear_out(&mut histories, &config, 0, 9);
    assert!(worn[8].forecast.actuator.is_ok() && worn[8].state < HealthState::Warning);
    let actuator = config.actuator_named("ema0").expect("watched");
    for n in 9..30 {
        let history = histories.history_at(actuator, 0).expect("levels");
        let job = job(&config, n, 10.0 * n as f64, 0.0);
        let assessment = history.update(&job, &evidence(None, &Fit::default()), &config);
        assert_eq!(assessment.state, worn[8].state, "window {n}");
    }
    let more = wear_out(&mut histories, &config, 30, 40);
    assert!(more.iter().any(|one| one.state == HealthState::Warning));
}

#[test]
fn another_part_leaves_the_alarm_by_remaining_life_as_it_is() {
    let config = config("hours = \"elapsed\"\nwarning_h = 10000");
    let at = |hours: f64| job(&config, 0, hours, 0.0).window.t_start_ns;
    for (part, state) in [
        (ReplacedPart::Controller, HealthState::Warning),
        (ReplacedPart::Gearbox, HealthState::Unknown),
    ] {
        let mut histories = HistoryStore::new(config.clone());
        wear_out(&mut histories, &config, 0, 20);
        histories.set_events(events(&[reset(at(195.0), Some(part))]));
        let actuator = config.actuator_named("ema0").expect("watched");
        let history = histories.history_at(actuator, at(200.0)).expect("levels");
        let job = job(&config, 20, 200.0, 0.0);
        let assessment = history.update(&job, &evidence(None, &Fit::default()), &config);
        assert_eq!(assessment.state, state, "{part:?}");
    }
}

/// Damages that are ruled out at the level of warning, and of which none is significant, add to nothing.
#[test]
fn insignificant_damages_together_miss_no_requirement() {
    let config = config("hours = \"elapsed\"");
    let slow = |faults: &[FaultVector; CHECK_LANES]| {
        let is_missed = |fault: &FaultVector| fault.short_a + fault.short_b + fault.short_c > 0.1;
        faults.map(|fault| is_missed(&fault).then_some(UnmetRequirement::SlewRate))
    };
    for (sigma, expected) in [
        (0.06, LimitingCriterion::Damage),
        (0.01, LimitingCriterion::Function(UnmetRequirement::SlewRate)),
    ] {
        let mut history = UnitHistory::new(&config, None).expect("levels");
        let mut shorts = friction(0.0);
        for short in [FaultId::ShortA, FaultId::ShortB, FaultId::ShortC] {
            shorts.damage[short.index()] = 0.06;
            shorts.sigma.as_mut().expect("sigmas")[short.index()] = sigma;
        }
        for n in 0..12 {
            let evidence = WindowEvidence {
                damage_evidence: Some(&shorts),
                fault: Some(&FaultVector::NOMINAL),
                fit: &Fit::default(),
                unmet_requirement: Some(&slow),
            };
            let found = history.update(&job(&config, n, 10.0 * n as f64, 0.0), &evidence, &config);
            assert!(n == 0 || found.limiting_criterion == expected, "± {sigma}, window {n}");
        }
    }
}

/// Friction is critical by its remaining life and jumps; the forecast of backlash alone would be a warning.
#[test]
fn a_jump_for_the_worse_leaves_a_critical_life_to_no_other_fault() {
    let config = config("hours = \"elapsed\"\nwarning_h = 4000\ncritical_h = 1000");
    let mut history = UnitHistory::new(&config, None).expect("levels");
    let mut jumped = 0;
    for n in 0..24_u32 {
        let mut worn = friction(if n < 16 { 0.008 * f64::from(n) } else { 0.5 });
        worn.damage[FaultId::Backlash.index()] = 0.003 * f64::from(n);
        let job = job(&config, n.into(), 10.0 * f64::from(n), 0.0);
        let found = history.update(&job, &evidence(Some(&worn), &Fit::default()), &config);
        let life = found.forecast.faults[FaultId::Friction.index()];
        let is_critical = found.state == HealthState::Critical;
        assert!(n != 15 || is_critical, "{:?}", found.forecast);
        if matches!(life, Err(NoTrend::Jumped { .. })) {
            jumped += 1;
            assert!(
                found.forecast.actuator.is_ok() && is_critical,
                "window {n}: {:?}",
                found.forecast
            );
        }
    }
    assert!(jumped > 0);
}

//! How old the newest sample of each actuator is: stale data must not pass for fresh.

use std::time::{Duration, Instant};

/// Age of the newest sample from which an actuator is `STALE`: a thousand samples at 400 Hz. It is looked at each second.
pub const STALE_AFTER: Duration = Duration::from_millis(2500);

/// The ages of all actuators that are watched.
#[derive(Debug)]
pub(super) struct Freshness(Vec<Age>);

#[derive(Debug)]
struct Age {
    actuator: String,
    /// Samples so far.
    samples: u64,
    /// When they were first found to be so many, or the start.
    since: Instant,
    stale: bool,
}

impl Freshness {
    pub(super) fn new(actuators: impl Iterator<Item = String>, now: Instant) -> Self {
        let begin = |actuator| Age {
            actuator,
            samples: 0,
            since: now,
            stale: false,
        };
        Self(actuators.map(begin).collect())
    }

    /// Takes the samples so far of those that were seen. Who has become stale (`true`) or is fresh again, with a sentence.
    pub(super) fn update<'a>(
        &mut self,
        now: Instant,
        seen: impl Iterator<Item = (&'a str, u64)>,
    ) -> Vec<(bool, String)> {
        let mut changes = Vec::new();
        for (actuator, samples) in seen {
            let known = self.0.iter_mut().find(|age| age.actuator == actuator);
            if let Some(age) = known.filter(|age| age.samples != samples) {
                if age.stale {
                    let gap = now.duration_since(age.since).as_secs_f64();
                    changes.push((false, format!("{actuator}: fresh again after {gap:.1} s")));
                }
                (age.samples, age.since, age.stale) = (samples, now, false);
            }
        }
        for age in &mut self.0 {
            if !age.stale && now.duration_since(age.since) >= STALE_AFTER {
                age.stale = true;
                let since = if age.samples == 0 { " since the start" } else { "" };
                let gap = now.duration_since(age.since).as_secs_f64();
                changes.push((
                    true,
                    format!("{}: STALE, no sample for {gap:.1} s{since}", age.actuator),
                ));
            }
        }
        changes
    }

    /// Whether an actuator is stale, by the last update.
    pub(super) fn is_stale(&self, actuator: &str) -> bool {
        self.0.iter().any(|age| age.actuator == actuator && age.stale)
    }

    /// Name, age in seconds and whether it is stale, in the order of the configuration.
    pub(super) fn ages(&self, now: Instant) -> impl Iterator<Item = (&str, f64, bool)> {
        let age = move |of: &Age| now.duration_since(of.since).as_secs_f64();
        self.0.iter().map(move |of| (of.actuator.as_str(), age(of), of.stale))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_actuator_without_samples_is_stale_until_the_next_sample() {
        let start = Instant::now();
        let at = |s| start + Duration::from_secs(s);
        let names = ["ema0", "ema1"].map(str::to_owned);
        let mut freshness = Freshness::new(names.into_iter(), start);
        let mut update =
            |s, samples: &[u64]| freshness.update(at(s), ["ema0"].into_iter().zip(samples.iter().copied()));
        assert_eq!(update(1, &[400]), []);
        assert_eq!(update(2, &[800]), []);
        assert_eq!(
            update(3, &[800]),
            [(true, "ema1: STALE, no sample for 3.0 s since the start".to_owned())]
        );
        assert_eq!(update(4, &[800]), [], "reported once");
        assert_eq!(
            update(5, &[800]),
            [(true, "ema0: STALE, no sample for 3.0 s".to_owned())]
        );
        assert_eq!(update(9, &[801]), [(false, "ema0: fresh again after 7.0 s".to_owned())]);
        let ages: Vec<_> = freshness.ages(at(10)).collect();
        assert_eq!(ages, [("ema0", 1.0, false), ("ema1", 10.0, true)]);
    }
}

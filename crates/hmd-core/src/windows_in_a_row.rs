//! What the newest windows of one actuator have in common: that none could be assessed, or that each doubts the same sensor.
//!
//! One window may be chance; [`NEWS_AFTER`] in a row are news for an operator.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::record::Health;

/// Windows in a row from which on something is news.
pub const NEWS_AFTER: u64 = 3;

/// Counts of the newest windows in a row. Bounded: at most one count for each kind of suspect.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct WindowsInARow {
    /// Those that could not be assessed.
    pub unassessed: u64,
    /// Those that name this sensor, wire or number, by its name.
    pub suspects: BTreeMap<String, u64>,
}

/// A sentence for an operator, and whether it is one for the worse.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct News {
    /// The sentence, without the actuator.
    pub text: String,
    /// Whether something is to be done.
    pub for_the_worse: bool,
}

impl WindowsInARow {
    /// Takes the next window; what became news by it.
    pub fn update(&mut self, health: &Health) -> Vec<News> {
        let mut news = Vec::new();
        let mut tell = |text: String, for_the_worse| news.push(News { text, for_the_worse });
        if health.estimate().is_none() {
            self.unassessed = self.unassessed.saturating_add(1);
            if self.unassessed == NEWS_AFTER {
                let reason = &health.reason;
                tell(
                    format!("{NEWS_AFTER} windows in a row could not be assessed, the last: {reason}"),
                    true,
                );
            }
        } else if std::mem::take(&mut self.unassessed) >= NEWS_AFTER {
            tell(format!("assessed again in window {}", health.window), false);
        }
        let before = std::mem::take(&mut self.suspects);
        for suspect in &health.suspects {
            let count = before.get(suspect).copied().unwrap_or(0).saturating_add(1);
            if count == NEWS_AFTER {
                let reason = &health.reason;
                tell(
                    format!("check {suspect}: {NEWS_AFTER} windows in a row name it, the last: {reason}"),
                    true,
                );
            }
            self.suspects.insert(suspect.clone(), count);
        }
        for (suspect, count) in before {
            if count >= NEWS_AFTER && !self.suspects.contains_key(&suspect) {
                tell(format!("{suspect} not named in window {}", health.window), false);
            }
        }
        news
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Estimate;

    fn window(assessed: bool, suspects: &[&str]) -> Health {
        let mut health = Health {
            reason: "why".to_owned(),
            suspects: suspects.iter().map(ToString::to_string).collect(),
            ..Health::default()
        };
        let estimate = Estimate {
            k: [0.0; 8],
            sigma: [None; 8],
            observable: [true; 8],
        };
        health.set_estimate(assessed.then_some(&estimate));
        health
    }

    fn told(windows: &[Health]) -> Vec<(usize, bool)> {
        let mut in_a_row = WindowsInARow::default();
        let told = windows.iter().enumerate().flat_map(|(n, health)| {
            let news = in_a_row.update(health);
            news.into_iter()
                .map(move |news| (n, news.for_the_worse))
                .collect::<Vec<_>>()
        });
        told.collect()
    }

    #[test]
    fn three_windows_in_a_row_are_told_once_and_their_end_too() {
        let (bad, good) = (window(false, &[]), window(true, &[]));
        assert_eq!(told(&[bad.clone(), bad.clone(), good.clone(), bad.clone()]), []);
        let row = [bad.clone(), bad.clone(), bad.clone(), bad, good.clone(), good.clone()];
        assert_eq!(told(&row), [(2, true), (4, false)]);
        let (order, both) = (
            window(true, &["phase order"]),
            window(true, &["phase order", "dc link"]),
        );
        let row = [order.clone(), both.clone(), both, order, good.clone(), good];
        assert_eq!(told(&row), [(2, true), (4, false)]);
    }
}

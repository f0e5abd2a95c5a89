//! Conditions that end a population search, and their test after each generation.

use crate::error::ConfigError;
use crate::log::{Control, GenerationLog};

/// Conditions that end a search. They are tested after every generation; the evaluation budget also shortens a generation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StopRule {
    /// Generations after the initial population.
    pub max_generations: u32,
    /// Length of the stall window `w`, generations; a window longer than `max_generations` never ends a search.
    pub max_stall_generations: u32,
    /// The search stalls when, over the last `w` best costs, `|first - last| / (w max(1, |last|))` is at most this value.
    ///
    /// This is MATLAB's average relative change. For costs below 1 it is an absolute change.
    pub function_tolerance: f64,
    /// The search ends when the best cost is at most this value.
    pub cost_limit: Option<f64>,
    /// Evaluation budget: the largest number of costs that the search computes.
    pub max_evaluations: Option<u64>,
}

impl StopRule {
    /// MATLAB's defaults for `ga`: `100 D` generations, stall window 50, tolerance 1e-6, no limits.
    #[must_use]
    pub fn for_dimension(dimension: u32) -> Self {
        Self {
            max_generations: dimension.saturating_mul(100),
            max_stall_generations: 50,
            function_tolerance: 1e-6,
            cost_limit: None,
            max_evaluations: None,
        }
    }

    /// Number of best costs to store: the stall window, or all generations when the window is longer than those.
    #[must_use]
    pub fn history(&self) -> u32 {
        self.max_stall_generations.min(self.max_generations.saturating_add(1))
    }

    /// Checks that every condition can be tested.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] with the first value out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        if self.max_stall_generations == 0 {
            return Err(ConfigError::StallWindow);
        }
        if !(self.function_tolerance >= 0.0 && self.function_tolerance.is_finite()) {
            return Err(ConfigError::FunctionTolerance {
                got: self.function_tolerance,
            });
        }
        if self.cost_limit.is_some_and(f64::is_nan) {
            return Err(ConfigError::CostLimit);
        }
        if self.max_evaluations == Some(0) {
            return Err(ConfigError::NoEvaluations);
        }
        Ok(())
    }
}

/// Why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// The search reached the last generation.
    MaxGenerations,
    /// The best cost changed by no more than the function tolerance over the stall window.
    Stall,
    /// The best cost reached the cost limit.
    CostLimit,
    /// The evaluation budget is used up.
    MaxEvaluations,
    /// The callback returned [`Control::Stop`].
    Stopped,
}

/// Evaluations and best costs of a running search, for its stop rule.
pub(crate) struct Progress<'a> {
    rule: StopRule,
    evaluations: u64,
    /// Best costs of the last `rule.history()` generations; that of generation `g` at index `g % len`.
    window: &'a mut [f64],
}

impl<'a> Progress<'a> {
    /// The start of a search; `window` has exactly `rule.history()` elements.
    pub(crate) fn new(rule: StopRule, window: &'a mut [f64]) -> Self {
        Self {
            rule,
            evaluations: 0,
            window,
        }
    }

    pub(crate) fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// Evaluations left in the budget.
    pub(crate) fn remaining_budget(&self) -> u64 {
        self.rule
            .max_evaluations
            .map_or(u64::MAX, |limit| limit - self.evaluations)
    }

    /// Counts evaluations against the budget.
    pub(crate) fn count_evaluations(&mut self, evaluations: usize) {
        self.evaluations += evaluations as u64;
    }

    /// Ends a generation: passes its line to the callback, and tests the stop rule unless the callback ends the search.
    pub(crate) fn end_generation<const D: usize>(
        &mut self,
        line: &GenerationLog<D>,
        observe: &mut impl FnMut(&GenerationLog<D>) -> Control,
    ) -> Option<StopReason> {
        let length = self.window.len();
        let now = line.generation as usize;
        self.window[now % length] = line.best_cost;
        let first = self.window[(now + 1) % length];
        let change = (first - line.best_cost).abs() / (length as f64 * line.best_cost.abs().max(1.0));

        if observe(line) == Control::Stop {
            Some(StopReason::Stopped)
        } else if self.rule.cost_limit.is_some_and(|limit| line.best_cost <= limit) {
            Some(StopReason::CostLimit)
        } else if self.remaining_budget() == 0 {
            Some(StopReason::MaxEvaluations)
        } else if line.generation >= self.rule.max_generations {
            Some(StopReason::MaxGenerations)
        } else if now > length && change <= self.rule.function_tolerance {
            Some(StopReason::Stall)
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_search_stalls_by_the_relative_change_over_the_window() {
        let rule = StopRule {
            max_stall_generations: 4,
            function_tolerance: 1e-3,
            ..StopRule::for_dimension(1)
        };
        let mut window = [0.0; 4];
        let mut progress = Progress::new(rule, &mut window);
        // 10 per generation out of 10 000: 3 steps in a window of 4, 30 / (4 * 10 000) = 7.5e-4.
        let stop = (0..20u32).find_map(|generation| {
            let best_cost = 1e4 - 10.0 * f64::from(generation);
            let line = GenerationLog {
                generation,
                evaluations: 0,
                best_cost,
                mean_cost: 0.0,
                spread: 0.0,
                best_genes: [0.0],
            };
            progress
                .end_generation(&line, &mut |_| Control::Continue)
                .map(|reason| (generation, reason))
        });
        assert_eq!(stop, Some((5, StopReason::Stall)));
    }

    #[test]
    fn the_search_does_not_stall_while_no_cost_is_finite() {
        let rule = StopRule {
            max_stall_generations: 2,
            max_generations: 9,
            ..StopRule::for_dimension(1)
        };
        let mut window = [0.0; 2];
        let mut progress = Progress::new(rule, &mut window);
        let last = (0..20u32).find_map(|generation| {
            let line = GenerationLog {
                generation,
                evaluations: 0,
                best_cost: f64::INFINITY,
                mean_cost: f64::INFINITY,
                spread: 0.0,
                best_genes: [0.0],
            };
            progress
                .end_generation(&line, &mut |_| Control::Continue)
                .map(|reason| (generation, reason))
        });
        assert_eq!(last, Some((9, StopReason::MaxGenerations)));
    }
}

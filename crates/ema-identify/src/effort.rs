//! The work that one assessment may take: monitor runs are requested before each stage, and granted in whole or in part.
//!
//! Requests come at points that depend on the window alone, so the short grants, numbered by request, are all that another
//! run needs to stop at the same places ([`RecordedGrants`]). Only an [`Allowance`] of a live run knows a clock.

use core::cell::{Cell, RefCell};
use std::vec::Vec;

/// What a monitor run costs depends on what it is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Population and descents to local optima.
    Search,
    /// Last descents, and how uncertain they are.
    Conclusion,
    /// The relations between measured signals; one run is one estimate.
    Relations,
}

impl Stage {
    /// Number of stages.
    pub const COUNT: usize = 3;
}

/// Work that a stage wants to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// What it is for.
    pub stage: Stage,
    /// Length of the window, s: the time of a run is proportional to it.
    pub window_s: f64,
    /// Monitor runs at most.
    pub runs: u64,
    /// Runs of [`Stage::Conclusion`] for which time should be left.
    pub reserved: u64,
}

/// Grants work, and is informed of it.
pub trait Allowance {
    /// Runs granted of a request; more than `runs` counts as all.
    fn grant(&mut self, request: &Request) -> u64;

    /// `runs` of a stage were done, the work around them included.
    fn ran(&mut self, stage: Stage, window_s: f64, runs: u64);
}

/// Answer to a request that was not granted in whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShortGrant {
    /// Number of the request, from 0.
    pub request: u64,
    /// Runs granted.
    pub runs: u64,
}

/// The work of one assessment.
pub struct Effort<'a> {
    allowance: Option<RefCell<&'a mut dyn Allowance>>,
    requests: Cell<u64>,
    short: RefCell<Vec<ShortGrant>>,
}

impl<'a> Effort<'a> {
    /// Everything is granted.
    #[must_use]
    pub fn unlimited() -> Self {
        Self {
            allowance: None,
            requests: Cell::new(0),
            short: RefCell::new(Vec::new()),
        }
    }

    /// As much as an allowance grants.
    pub fn within(allowance: &'a mut dyn Allowance) -> Self {
        Self {
            allowance: Some(RefCell::new(allowance)),
            ..Self::unlimited()
        }
    }

    /// Runs granted of a request.
    pub fn grant(&self, request: &Request) -> u64 {
        let Some(allowance) = &self.allowance else {
            return request.runs;
        };
        let number = self.requests.replace(self.requests.get() + 1);
        let runs = allowance.borrow_mut().grant(request).min(request.runs);
        if runs < request.runs {
            self.short.borrow_mut().push(ShortGrant { request: number, runs });
        }
        runs
    }

    /// Whether a request is granted in whole; none is once another one was not.
    pub fn grants_all(&self, request: &Request) -> bool {
        !self.is_short() && self.grant(request) == request.runs
    }

    /// Runs were done.
    pub fn ran(&self, stage: Stage, window_s: f64, runs: u64) {
        if let Some(allowance) = &self.allowance {
            allowance.borrow_mut().ran(stage, window_s, runs);
        }
    }

    /// Whether any request was not granted in whole.
    #[must_use]
    pub fn is_short(&self) -> bool {
        !self.short.borrow().is_empty()
    }

    /// The short grants so far, by their requests.
    #[must_use]
    pub fn short_grants(&self) -> Vec<ShortGrant> {
        self.short.borrow().clone()
    }
}

/// Grants as they were recorded, in any order; what is not recorded is granted in whole.
#[derive(Clone, Debug, Default)]
pub struct RecordedGrants {
    short: Vec<ShortGrant>,
    requests: u64,
}

impl RecordedGrants {
    /// For one assessment.
    #[must_use]
    pub fn new(short: Vec<ShortGrant>) -> Self {
        Self { short, requests: 0 }
    }
}

impl Allowance for RecordedGrants {
    fn grant(&mut self, request: &Request) -> u64 {
        let number = self.requests;
        self.requests += 1;
        let recorded = self.short.iter().find(|short| short.request == number);
        recorded.map_or(request.runs, |short| short.runs)
    }

    fn ran(&mut self, _: Stage, _: f64, _: u64) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Grants a number of runs in all.
    struct Purse(u64);

    impl Allowance for Purse {
        fn grant(&mut self, request: &Request) -> u64 {
            request.runs.min(self.0)
        }
        fn ran(&mut self, _: Stage, _: f64, runs: u64) {
            self.0 -= runs;
        }
    }

    fn requests(effort: &Effort<'_>) -> Vec<u64> {
        let wanted = [10, 30, 5, 7].into_iter();
        wanted
            .map(|runs| {
                let request = Request {
                    stage: Stage::Search,
                    window_s: 0.5,
                    runs,
                    reserved: 0,
                };
                let granted = effort.grant(&request);
                effort.ran(Stage::Search, 0.5, granted.min(12));
                granted
            })
            .collect()
    }

    #[test]
    fn recorded_grants_answer_as_the_allowance_did() {
        let mut purse = Purse(28);
        let live = Effort::within(&mut purse);
        assert_eq!(requests(&live), [10, 18, 5, 1]);
        let short = live.short_grants();
        assert_eq!(short.iter().map(|short| short.request).collect::<Vec<_>>(), [1, 3]);
        let mut recorded = RecordedGrants::new(short.clone());
        let replayed = Effort::within(&mut recorded);
        assert_eq!(requests(&replayed), [10, 18, 5, 1]);
        assert_eq!(replayed.short_grants(), short);
    }

    #[test]
    fn without_an_allowance_everything_is_granted() {
        let effort = Effort::unlimited();
        assert_eq!(requests(&effort), [10, 30, 5, 7]);
        assert!(!effort.is_short());
    }
}

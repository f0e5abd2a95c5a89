//! All states of the program's own [`KeptWindows`], by windows that are valid or not, commissionings that succeed or fail, restarts
//! before and after what was learnt is on the disk, and another unit.

use crate::kept_windows::KeptWindows;
use stateright::{Checker, Model, Property};

/// `learn_windows`: odd, so that half of them is not whole.
const NEEDED: usize = 5;
/// Windows that come.
const WINDOWS: u32 = 14;

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Step {
    /// A window that is `invalid`.
    Invalid,
    /// Any other. Where it completes its unit's, whether they commission it.
    Valid { succeeds: bool },
    /// What was learnt gets to the disk.
    Saved,
    /// The process is killed, or reloads its configuration.
    Restart,
    /// Another unit takes the place.
    OtherUnit,
}

/// What the learner keeps, and what is known of the windows so far.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Learning {
    kept: KeptWindows<u32>,
    /// What assesses the unit: the windows that it was commissioned by.
    learnt: Option<Vec<u32>>,
    saved: Option<Vec<u32>>,
    windows: u32,
    /// Valid windows since learning began, or since the last restart or change of the unit.
    valid: Vec<u32>,
    /// Windows of the last attempt, if the last step was one; after how many valid ones since the attempt before.
    attempt: Option<(Vec<u32>, usize)>,
    since_attempt: usize,
}

impl Learning {
    fn begin_again(&mut self, learnt: Option<Vec<u32>>) {
        self.learnt = learnt;
        self.kept = KeptWindows::default();
        self.valid.clear();
        self.since_attempt = 0;
    }
}

struct Windows;

impl Model for Windows {
    type State = Learning;
    type Action = Step;

    fn init_states(&self) -> Vec<Learning> {
        vec![Learning {
            kept: KeptWindows::default(),
            learnt: None,
            saved: None,
            windows: 0,
            valid: Vec::new(),
            attempt: None,
            since_attempt: 0,
        }]
    }

    fn actions(&self, state: &Learning, actions: &mut Vec<Step>) {
        if state.windows < WINDOWS {
            actions.extend([Step::Invalid, Step::Valid { succeeds: false }]);
            if state.kept.len() + 1 >= NEEDED {
                actions.push(Step::Valid { succeeds: true });
            }
            actions.extend([Step::Restart, Step::OtherUnit]);
            if state.learnt != state.saved {
                actions.push(Step::Saved);
            }
        }
    }

    fn next_state(&self, state: &Learning, step: Step) -> Option<Learning> {
        let mut next = state.clone();
        next.attempt = None;
        match step {
            Step::Invalid => next.windows += 1,
            Step::Valid { succeeds } => {
                let window = next.windows;
                next.windows += 1;
                if next.learnt.is_none() {
                    next.valid.push(window);
                    next.since_attempt += 1;
                    if next.kept.keep(window, NEEDED) {
                        let by = next.kept.windows().to_vec();
                        next.attempt = Some((by.clone(), next.since_attempt));
                        next.since_attempt = 0;
                        if succeeds {
                            next.learnt = Some(by);
                            next.kept = KeptWindows::default();
                        } else {
                            next.kept.drop_older_half();
                        }
                    }
                }
            }
            Step::Saved => next.saved.clone_from(&next.learnt),
            Step::Restart => next.begin_again(state.saved.clone()),
            Step::OtherUnit => {
                next.saved = None;
                next.begin_again(None);
            }
        }
        (next != *state).then_some(next)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![
            Property::always("fewer windows wait than are needed", |_, state: &Learning| {
                state.kept.len() < NEEDED && (state.learnt.is_none() || state.kept.len() == 0)
            }),
            Property::always(
                "an attempt is by the newest valid windows, as many as are needed",
                |_, state: &Learning| {
                    state.attempt.as_ref().is_none_or(|(by, _)| {
                        by.len() == NEEDED && state.valid.ends_with(by) && by.is_sorted_by(|a, b| a < b)
                    })
                },
            ),
            Property::always(
                "each attempt has windows that the one before had not, and is not late",
                |_, state: &Learning| {
                    state
                        .attempt
                        .as_ref()
                        .is_none_or(|(_, since)| *since == NEEDED || *since == NEEDED.div_ceil(2))
                        && state.since_attempt < NEEDED
                },
            ),
            Property::sometimes("commissioned after a failure", |_, state: &Learning| {
                state.learnt.as_ref().is_some_and(|by| by[0] == 3)
            }),
            Property::sometimes("learnt again after a restart before the file", |_, state: &Learning| {
                state.saved.is_none() && state.learnt.as_ref().is_some_and(|by| by[0] == 5)
            }),
        ]
    }
}

#[test]
fn all_states_of_learning() {
    let checker = Windows.checker().threads(2).spawn_bfs().join();
    println!(
        "learning: {} states, {} steps",
        checker.unique_state_count(),
        checker.state_count()
    );
    checker.assert_properties();
}

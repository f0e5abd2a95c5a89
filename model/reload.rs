//! All states of the program's own [`Requests`], by signals at any moment of a reload, and a configuration that changes meanwhile.

use crate::requests::{Request, Requests};
use stateright::{Checker, Model, Property};

/// Changes of the file of the configuration, and signals.
const CHANGES: u8 = 3;
const SIGNALS: u8 = 5;

/// A configuration, by the number of its change; or one that cannot be used.
type File = Result<u8, ()>;

/// What the daemon does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Doing {
    /// It watches.
    Runs,
    /// It has taken a request, and reads the file next.
    Loads,
    /// The run with the configuration before ends; its windows are assessed.
    Ends(u8),
    Stopped,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Step {
    Signal(Request),
    /// The file is replaced, by a good or a bad one.
    Change {
        is_good: bool,
    },
    /// The daemon's next step.
    Daemon,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Run {
    requests: Requests,
    doing: Doing,
    /// Of the run.
    configuration: u8,
    file: File,
    changes: u8,
    signals: u8,
    /// The file as it was at the last reload that was asked for.
    asked: Option<File>,
    /// Since that the file changed.
    changed: bool,
    stop_asked: bool,
    /// Reloads that were asked for, and those begun.
    reloads: [u8; 2],
    /// Steps of the daemon since a stop was asked for.
    steps_after_stop: u8,
}

impl Run {
    /// One step of the loop of `hmd run`.
    fn step(&mut self) {
        self.doing = match self.doing {
            Doing::Runs => match self.requests.next() {
                Some(Request::Stop) => Doing::Stopped,
                Some(Request::Reload) => {
                    self.reloads[1] += 1;
                    Doing::Loads
                }
                None => Doing::Runs,
            },
            Doing::Loads => self.file.map_or(Doing::Runs, Doing::Ends),
            Doing::Ends(next) => {
                self.configuration = next;
                Doing::Runs
            }
            Doing::Stopped => Doing::Stopped,
        };
    }

    /// Nothing is left to do.
    fn is_quiet(&self) -> bool {
        let mut requests = self.requests;
        self.doing == Doing::Stopped || self.doing == Doing::Runs && requests.next().is_none()
    }
}

struct Signals;

impl Model for Signals {
    type State = Run;
    type Action = Step;

    fn init_states(&self) -> Vec<Run> {
        vec![Run {
            requests: Requests::default(),
            doing: Doing::Runs,
            configuration: 0,
            file: Ok(0),
            changes: 0,
            signals: 0,
            asked: None,
            changed: false,
            stop_asked: false,
            reloads: [0; 2],
            steps_after_stop: 0,
        }]
    }

    fn actions(&self, state: &Run, actions: &mut Vec<Step>) {
        if state.signals < SIGNALS {
            actions.extend([Request::Stop, Request::Reload].map(Step::Signal));
        }
        if state.changes < CHANGES {
            actions.extend([true, false].map(|is_good| Step::Change { is_good }));
        }
        if !state.is_quiet() {
            actions.push(Step::Daemon);
        }
    }

    fn next_state(&self, state: &Run, step: Step) -> Option<Run> {
        let mut next = state.clone();
        match step {
            Step::Signal(request) => {
                next.signals += 1;
                next.requests.ask(request);
                match request {
                    Request::Stop => next.stop_asked = true,
                    Request::Reload => {
                        next.reloads[0] += 1;
                        (next.asked, next.changed) = (Some(next.file), false);
                    }
                }
            }
            Step::Change { is_good } => {
                next.changes += 1;
                next.file = is_good.then_some(next.changes).ok_or(());
                next.changed = true;
            }
            Step::Daemon => {
                next.step();
                next.steps_after_stop += u8::from(next.stop_asked && state.doing != Doing::Stopped);
            }
        }
        Some(next)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![
            Property::always("a stop is obeyed after what is being done", |_, state: &Run| {
                // To read a file, to end its run, and to stop.
                state.steps_after_stop <= 3 && (!state.stop_asked || !state.is_quiet() || state.doing == Doing::Stopped)
            }),
            Property::always(
                "the last reload takes the file as it was then, or later",
                |_, state: &Run| {
                    let Some(Ok(asked)) = state.asked else { return true };
                    state.stop_asked || !state.is_quiet() || state.configuration == asked || state.changed
                },
            ),
            Property::always("a file that cannot be used changes nothing", |_, state: &Run| {
                state.configuration <= state.changes && (state.asked.is_some() || state.configuration == 0)
            }),
            Property::always("nothing is done that was not asked for", |_, state: &Run| {
                let [asked, begun] = state.reloads;
                begun <= asked && (asked > 0 || state.stop_asked || state.doing == Doing::Runs)
            }),
            Property::sometimes("stopped while a run ends", |_, state: &Run| {
                state.doing == Doing::Stopped && state.configuration == CHANGES
            }),
            Property::sometimes("two reloads in one", |_, state: &Run| {
                state.signals == 2 && state.configuration == 2 && state.asked == Some(Ok(2))
            }),
        ]
    }
}

#[test]
fn all_states_of_a_reload() {
    let checker = Signals.checker().threads(2).spawn_bfs().join();
    println!(
        "reload: {} states, {} steps",
        checker.unique_state_count(),
        checker.state_count()
    );
    checker.assert_properties();
}

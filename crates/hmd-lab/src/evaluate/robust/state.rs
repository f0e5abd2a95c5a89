//! Results of finished units as text, so that a run that ended early is resumed: a line for the run, then a line for each unit.

use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::LazyLock;

use ema_models::ActuatorParams;
use ema_models::reference::Effects;
use serde::{Deserialize, Serialize};

use super::score::Tally;
use super::{RobustOptions, StateError};

/// What belongs to a run; results of another one are of no use.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Run {
    suite: String,
    version: String,
    /// Hash of the executable; `None` where it cannot be read.
    program: Option<String>,
    rate_hz: f64,
    n: u64,
    seed: u64,
}

/// Hash of the running executable, so that no other build resumes what this one began.
static PROGRAM: LazyLock<Option<String>> = LazyLock::new(|| {
    let executable = fs::read(std::env::current_exe().ok()?).ok()?;
    Some(hash(&executable))
});

/// The finished unit of one entry and actuator type.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FinishedUnit {
    pub(super) entry: String,
    pub(super) actuator: String,
    /// Hash of what the unit was: its effects and the parameters of its type.
    pub(super) drawn: String,
    /// Why the unit was not calibrated; `None` where it was.
    pub(super) refused: Option<String>,
    pub(super) before: Tally,
    pub(super) after: Tally,
    pub(super) elsewhere: Tally,
}

impl FinishedUnit {
    /// Its line, with the end of the line.
    #[must_use]
    pub fn line(&self) -> String {
        line(self)
    }
}

/// The first line of the state of a run, with the end of the line.
#[must_use]
pub fn first_line(options: &RobustOptions) -> String {
    line(&Run::of(options))
}

/// Finished units out of the state of an earlier run, and the length of the text that is whole: a last line without end was cut
/// while it was written. Empty text is the state of a run that has not begun.
///
/// # Errors
/// [`StateError`] when it is the state of another run or no state at all.
pub fn read_state(text: &str, options: &RobustOptions) -> Result<(Vec<FinishedUnit>, usize), StateError> {
    let whole = text.rfind('\n').map_or(0, |end| end + 1);
    let mut lines = text[..whole].lines().enumerate();
    let refused = |(n, line): (usize, &str)| StateError::Line {
        line: n + 1,
        found: line.chars().take(FOUND_CHARS).collect(),
    };
    let Some(first) = lines.next() else {
        // The first line may have been cut as well; anything else is not ours to overwrite.
        return if first_line(options).starts_with(text) {
            Ok((Vec::new(), 0))
        } else {
            Err(refused((0, text)))
        };
    };
    let run: Run = serde_json::from_str(first.1).map_err(|_| refused(first))?;
    let expected = Run::of(options);
    if run != expected {
        return Err(StateError::OtherRun {
            expected: line(&expected).trim_end().to_owned(),
            found: line(&run).trim_end().to_owned(),
        });
    }
    let units = lines.map(|line| serde_json::from_str(line.1).map_err(|_| refused(line)));
    Ok((units.collect::<Result<_, _>>()?, whole))
}

/// Characters of a bad line that an error shows.
const FOUND_CHARS: usize = 60;

impl Run {
    fn of(options: &RobustOptions) -> Self {
        Self {
            suite: super::SUITE.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            program: PROGRAM.clone(),
            rate_hz: options.rate_hz,
            n: options.n,
            seed: options.seed,
        }
    }
}

fn line(value: &impl Serialize) -> String {
    // Numbers, names and lists of them always serialise.
    serde_json::to_string(value).unwrap_or_default() + "\n"
}

/// Hash of what a unit is: its effects and the parameters of its type, of which every digit counts.
pub(super) fn drawn(effects: &Effects, params: &ActuatorParams) -> String {
    hash(&format!("{effects:?} {params:?}"))
}

fn hash(value: &impl Hash) -> String {
    let mut hasher = DefaultHasher::new();
    value.hash(&mut hasher);
    format!("{:016x}", hasher.finish())
}

//! The state of all actuators on one screen: what `hmd top` shows.
//!
//! [`Follow`] reads the records of a folder or a file as they come and puts them into a [`State`]; [`Model`] puts the
//! state at a moment into words and figures; [`draw()`] puts the model on a screen. [`show()`] does all of it on a terminal, and is the only
//! one that touches a terminal or a clock; only [`Follow`] touches files.

mod detail;
mod draw;
mod follow;
mod model;
mod process;
mod state;
mod terminal;

pub use draw::{Colours, Cursor, HEIGHT_MIN, WIDTH_MIN, draw, full_height};
pub use follow::{Follow, FollowError, Progress};
pub use model::{Condition, Freshness, Model, NEWS_MAX_S, Row};
pub use state::{Event, Known, State};
pub use terminal::{ScreenEnd, TerminalError, Watch, show};

#[cfg(test)]
mod tests;

//! How all actuators stand, on one screen: what `hmd top` shows.
//!
//! [`Follow`] reads the records of a folder or a file as they come and puts them into a [`State`]; [`Model`] says in words
//! and figures what the state means at a moment; [`draw()`] puts the model on a screen. Only the first touches files, none
//! touches a terminal or a clock.

mod detail;
mod draw;
mod follow;
mod model;
mod process;
mod state;

pub use draw::{Colours, Cursor, HEIGHT_MIN, WIDTH_MIN, draw, full_height};
pub use follow::{Follow, FollowError, Progress};
pub use model::{Condition, Freshness, Model, NEWS_MAX_S, Row};
pub use state::{Event, Known, State};

#[cfg(test)]
mod tests;

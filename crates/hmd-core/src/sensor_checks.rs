//! Wrong sensors, wires and configured numbers: what tells them from worn parts.
//!
//! In: a window and what is known of its actuator. Out: what is suspected ([`Suspicion`]), each a sentence with its numbers.

mod suspect;

pub use suspect::{Suspect, Suspicion};

//! A bus that is already there: its DBC file, and which of its signals are the quantities that are watched.
//!
//! ```text
//! DBC text ─ Database ─ SignalMap (of one actuator) ─┐
//! RawFrame ──────────────────── MappedBus ── Joiner ─┴─> Sample, MeasuredConditions
//! ```
//!
//! [`Signal`] says where a value lies in a frame, [`Database`] which there are, [`SignalMap`] which of them are currents,
//! angles, commands and conditions. [`Joiner`] puts the parts of one sample together; what comes out is the same
//! [`ema_wire::Sample`] that the built-in dictionary gives, in its steps (1 mA, one count, 1 µrad, 1 mrad/s), so that
//! everything behind it is the same. How to write a map: `docs/dbc.md`.

mod bus;
mod database;
mod joiner;
mod latched;
mod map;
mod signal;
mod unit;

pub use bus::MappedBus;
pub use database::{Database, DbcError, DbcMessage, DbcSignal};
pub use joiner::{DecodedUpdate, Joiner};
pub use latched::{Latched, SampleMaker};
pub use map::{Binding, MapDraft, MessageUse, Misfit, ModeCodes, Role, SignalMap};
pub use signal::{Layout, Selector, Signal, SignalKind};
pub use unit::{Dimension, Unit};

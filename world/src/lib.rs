//! The whole daemon in a simulated world: one seed gives frames, failures of bus, disk, power and clock, and signals; what must hold is
//! checked after every run. `docs/design/world.md` says what is simulated and what not.

mod check;
pub mod clock;
pub mod disk;
mod health_oracle;
pub mod plan;
mod run;
pub mod stand_in;
pub mod traffic;

pub use check::{Outcome, shrink};
pub use run::run;

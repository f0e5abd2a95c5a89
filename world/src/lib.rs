//! The whole daemon in a simulated world: one seed gives frames, failures of bus, disk, power and clock, and signals; what must hold is
//! checked after every run. `docs/design/world.md` says what is simulated and what not.

mod bus;
mod check;
pub mod clock;
pub mod disk;
mod disturb;
mod health_oracle;
mod host;
pub mod plan;
mod run;
mod segment;
mod shrink;
pub mod stand_in;
pub mod traffic;

use plan::Plan;

pub use check::Outcome;
pub use shrink::shrink;

/// Runs the world of a plan and checks it; with `show`, prints what the program said.
///
/// # Errors
/// The real folder in which the world lives cannot be used.
pub fn run(plan: &Plan, show: bool) -> anyhow::Result<Outcome> {
    let (world, host) = run::live(plan, show)?;
    check::check(world, &host)
}

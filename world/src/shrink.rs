//! The shortest form of what fails.

use anyhow::Context;

use crate::check::check;
use crate::plan::Plan;
use crate::run::live;

/// The shortest list of disturbances of a plan that still fails.
///
/// # Errors
/// Those of a run.
pub fn shrink(plan: &Plan) -> anyhow::Result<Plan> {
    // A shorter list may fail otherwise; that is another failure.
    let kind = |violation: &String| violation.replace(|letter: char| letter.is_ascii_digit(), "");
    let kinds_of = |plan: &Plan| -> anyhow::Result<Vec<String>> {
        let (world, host) = live(plan, false).context("a shorter run")?;
        let outcome = check(world, &host)?;
        Ok(outcome.violations.iter().map(kind).collect())
    };
    let first = kinds_of(plan)?.into_iter().next();
    let fails =
        |plan: &Plan| -> anyhow::Result<bool> { Ok(kinds_of(plan)?.into_iter().any(|kind| Some(kind) == first)) };
    let mut plan = plan.clone();
    let mut size = plan.disturbances.len().div_ceil(2);
    while size > 0 {
        let mut at = 0;
        while at < plan.disturbances.len() {
            let mut shorter = plan.clone();
            let end = (at + size).min(shorter.disturbances.len());
            shorter.disturbances.drain(at..end);
            if fails(&shorter)? {
                plan = shorter;
            } else {
                at += size;
            }
        }
        size /= 2;
    }
    Ok(plan)
}

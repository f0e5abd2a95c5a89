//! Reasons of a window in words: what its estimate leaves open.

use ema_identify::Estimate;
use ema_models::{FaultId, FaultVector};

use crate::health::{DamageEvidence, Levels};

/// The reason that names what a deadline left out.
pub(super) fn cut_by_deadline(deadline_ms: u32, estimate: &Estimate, unchecked: bool) -> String {
    let unchecked = if unchecked { ", readings not compared" } else { "" };
    format!(
        "deadline of {deadline_ms} ms: best of {} evaluations{unchecked}",
        estimate.evaluations
    )
}

/// The reason that names the faults of which the window tells nothing; the direction k7 is no handicap.
pub(super) fn unseen(estimate: &Estimate) -> Option<String> {
    let names: Vec<&str> = FaultId::ALL
        .into_iter()
        .filter(|fault| estimate.sigma[fault.parameter()].is_none())
        .map(FaultId::name)
        .collect();
    (!names.is_empty()).then(|| format!("not excited: {}", names.join(", ")))
}

/// The reason that names the faults whose damage is too uncertain to tell their state, and what would tell more.
pub(super) fn too_uncertain(
    evidence: &DamageEvidence,
    levels: &[Levels; FaultId::COUNT],
    is_commissioned: bool,
) -> Option<String> {
    let damages: Vec<String> = evidence
        .uncertain(levels)
        .into_iter()
        .map(|(fault, damage, sigma)| format!("{} {damage:.2} ± {sigma:.2}", fault.name()))
        .collect();
    let unknown_unit = if is_commissioned {
        ""
    } else {
        " (unit not commissioned)"
    };
    (!damages.is_empty()).then(|| format!("too uncertain: {}{unknown_unit}", damages.join(", ")))
}

/// The reason that names the values of a competing optimum, which explains the window as well.
pub(super) fn ambiguous(estimate: &Estimate, other: &FaultVector) -> String {
    let (k, other) = (estimate.fault.to_array(), other.to_array());
    let names: Vec<String> = FaultId::ALL
        .into_iter()
        .map(|fault| (fault.name(), k[fault.parameter()], other[fault.parameter()]))
        .filter(|(_, k, other)| (k - other).abs() > NOTABLE_DIFFERENCE)
        .map(|(name, k, other)| format!("{name} {k:.2} or {other:.2}"))
        .collect();
    format!("ambiguous: {}", names.join(", "))
}

/// Difference between competing optima from which on it is named.
const NOTABLE_DIFFERENCE: f64 = 0.02;

//! Damages that fell without a recorded repair, as the reason of a window says it.

use ema_models::FaultId;

/// Why a window is doubted whose damage no longer has what earlier windows had: no damage heals. Begins the reason.
pub const FELL: &str = "damage fell without a recorded repair";

/// What to do about it. Ends the reason.
pub const FELL_ADVICE: &str = "record the maintenance with hmd event, or check the sensors";

/// Which damages the reason of a window says to have fallen, in the order of [`FaultId::ALL`].
#[must_use]
pub fn fallen_by(reason: &str) -> [bool; FaultId::COUNT] {
    let mut reasons = reason.split("; ");
    let fell = reasons.find(|reason| reason.starts_with(FELL)).unwrap_or_default();
    FaultId::ALL.map(|fault| fell.contains(&format!("{} ", fault.name())))
}

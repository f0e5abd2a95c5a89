//! The levels of all faults as JSON: the metadata of a recording tell by which it was made.

use std::collections::BTreeMap;

use ema_models::FaultId;

use crate::health::Levels;

/// The levels of each fault by its name, as one line of JSON.
#[must_use]
pub fn levels_text(levels: &[Levels; FaultId::COUNT]) -> String {
    let by_fault: BTreeMap<_, _> = FaultId::NAMES.into_iter().zip(levels).collect();
    // Names and finite numbers always are JSON.
    serde_json::to_string(&by_fault).unwrap_or_default()
}

/// The levels that [`levels_text`] wrote; `None` of any other text.
#[must_use]
pub fn levels_from_text(text: &str) -> Option<[Levels; FaultId::COUNT]> {
    let mut by_fault: BTreeMap<String, Levels> = serde_json::from_str(text).ok()?;
    let mut of_fault = |name: &str| by_fault.remove(name)?.checked().ok();
    let all: Option<Vec<Levels>> = FaultId::NAMES.into_iter().map(&mut of_fault).collect();
    all.filter(|_| by_fault.is_empty())?.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_read_as_they_were_written_and_nothing_else_is() {
        let mut levels = [Levels::default(); FaultId::COUNT];
        levels[0].critical = 0.123_456_789;
        levels[0].warning = 0.1;
        levels[6].persistence = 3;
        let text = levels_text(&levels);
        assert_eq!(levels_from_text(&text), Some(levels));
        let refused = [
            "",
            "{}",
            &text.replace("friction", "rust"),
            &text.replace("{\"backlash", "{\"rust\":{},\"backlash"),
            &text.replace("0.3", "NaN"),
            &text.replace("0.8", "0.1"),
            &text.replace("hysteresis", "width"),
        ];
        for refused in refused {
            assert_eq!(levels_from_text(refused), None, "{refused}");
        }
    }
}

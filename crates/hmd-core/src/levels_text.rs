//! The levels of all faults as one line of text: the metadata of a recording tell by which it was made.

use ema_models::FaultId;

use crate::health::Levels;

/// Levels in the order of [`FaultId::ALL`], joined by `;`; of each `watch`, `warning`, `critical`, `end_of_life`, `hysteresis` and
/// `persistence`, joined by `,`.
#[must_use]
pub fn levels_text(levels: &[Levels; FaultId::COUNT]) -> String {
    let of_fault = |levels: &Levels| {
        let Levels {
            watch,
            warning,
            critical,
            end_of_life,
            hysteresis,
            persistence,
        } = levels;
        format!("{watch},{warning},{critical},{end_of_life},{hysteresis},{persistence}")
    };
    levels.iter().map(of_fault).collect::<Vec<_>>().join(";")
}

/// The levels that [`levels_text`] wrote; `None` of any other text.
#[must_use]
pub fn levels_from_text(text: &str) -> Option<[Levels; FaultId::COUNT]> {
    let of_fault = |text: &str| {
        let mut values = text.split(',');
        let mut number = || values.next()?.parse::<f64>().ok();
        let [watch, warning, critical, end_of_life, hysteresis] =
            [number()?, number()?, number()?, number()?, number()?];
        let persistence = values.next()?.parse().ok()?;
        let levels = Levels {
            watch,
            warning,
            critical,
            end_of_life,
            hysteresis,
            persistence,
        };
        levels.checked().ok().filter(|_| values.next().is_none())
    };
    let all: Option<Vec<Levels>> = text.split(';').map(of_fault).collect();
    all?.try_into().ok()
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
            "0.05,0.3",
            &text[1..].replace(';', ","),
            &format!("{text};0.05,0.3,0.6,0.8,0.02,1"),
            &text.replace("0.3", "NaN"),
            &text.replace("0.8", "0.1"),
        ];
        for refused in refused {
            assert_eq!(levels_from_text(refused), None, "{refused}");
        }
    }
}

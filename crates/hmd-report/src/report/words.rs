//! Times, damages and sentences as people read them.

use hmd_core::record::Shown;

/// Factor on a standard deviation for 95 %.
pub(super) const NORMAL_95: f64 = 1.96;

/// Operating time as people read it.
pub(super) fn duration(hours: f64) -> String {
    match hours {
        h if h >= 9.95 => format!("{h:.0} h"),
        h if h >= 0.995 => format!("{h:.1} h"),
        h if h >= 1.0 / 60.0 => format!("{:.0} min", 60.0 * h),
        h if h <= 0.0 => "0 h".to_owned(),
        _ => "less than 1 min".to_owned(),
    }
}

/// Quantiles of an operating time: where some is left, none of them is "0 h".
pub(super) fn durations(quantiles: [f64; 3]) -> [String; 3] {
    let is_over = quantiles[2] <= 0.0;
    quantiles.map(|hours| duration(if is_over { hours } else { hours.max(f64::MIN_POSITIVE) }))
}

/// Median and 80 % interval of an operating time.
pub(super) fn hours(quantiles: [f64; 3]) -> String {
    let [low, median, high] = durations(quantiles);
    if low == high {
        return median;
    }
    format!("{median} ({low} … {high})")
}

/// A damage in percent.
pub(super) fn percent_of(damage: f64) -> String {
    format!("{:.1} %", 100.0 * damage)
}

/// Between which damages it is with 95 % probability; `None` without a sigma.
pub(super) fn range_of(shown: Shown) -> Option<String> {
    let half = NORMAL_95 * shown.sigma?;
    let ends = [shown.damage - half, shown.damage + half].map(|end| 100.0 * end.clamp(0.0, 1.0));
    Some(format!("{:.1} to {:.1} %", ends[0], ends[1]))
}

/// The text with a capital letter at its start.
pub(super) fn with_capital(text: &str) -> String {
    let mut chars = text.chars();
    chars
        .next()
        .map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_the_unit_that_suits_them() {
        let shown = [1234.4, 9.96, 9.94, 0.996, 0.5, 0.017, 0.01, 0.0].map(duration);
        let expected = [
            "1234 h",
            "10 h",
            "9.9 h",
            "1.0 h",
            "30 min",
            "1 min",
            "less than 1 min",
            "0 h",
        ];
        assert_eq!(shown, expected);
        assert_eq!(hours([0.0, 1e-4, 2e-4]), "less than 1 min");
        assert_eq!(hours([0.0, 1.0, 20.0]), "1.0 h (less than 1 min … 20 h)");
        assert_eq!(hours([0.0; 3]), "0 h");
    }
}

//! Which known key a misspelt one was meant to be.

use strsim::levenshtein;

/// Nothing longer is a slip of a known key, bytes.
const LONGEST_KEY: usize = 80;

/// The known key that differs least from `key`, if the difference looks like a slip.
pub(super) fn closest<'k>(key: &str, known: &[&'k str]) -> Option<&'k str> {
    if key.len() > LONGEST_KEY {
        return None;
    }
    let (distance, best) = known.iter().map(|&k| (levenshtein(key, k), k)).min()?;
    // A third of the letters, or a key whose unit alone is missing.
    let unit_missing = key.len() >= 4 && best.starts_with(key);
    (distance <= (key.chars().count() / 3).max(1) || unit_missing).then_some(best)
}

/// The `most` known names that differ least from `name`, whatever their case; the closest first.
pub(super) fn nearest(name: &str, known: impl Iterator<Item = String>, most: usize) -> Vec<String> {
    let name: String = name.to_lowercase().chars().take(LONGEST_KEY).collect();
    let mut by_distance: Vec<_> = known.map(|of| (levenshtein(&name, &of.to_lowercase()), of)).collect();
    by_distance.sort();
    by_distance.into_iter().take(most).map(|(_, of)| of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_recognised_and_unrelated_words_are_not() {
        let known = ["duration_ms", "rest_ms", "phase_resistance_ohm"];
        assert_eq!(closest("duration_m", &known), Some("duration_ms"));
        assert_eq!(closest("duration", &known), Some("duration_ms"));
        assert_eq!(closest("colour", &known), None);
        let offered = nearest("rest", known.into_iter().map(str::to_owned), 2);
        assert_eq!(offered, ["rest_ms", "duration_ms"]);
    }
}

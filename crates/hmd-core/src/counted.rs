//! Counts in sentences.

/// So many of something, in the singular or the plural: `1 frame`, `2 frames`, `0 frames`.
#[must_use]
pub fn counted(count: u64, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_one_is_singular() {
        let texts = [0, 1, 2].map(|count| counted(count, "damaged place", "damaged places"));
        assert_eq!(texts, ["0 damaged places", "1 damaged place", "2 damaged places"]);
    }
}

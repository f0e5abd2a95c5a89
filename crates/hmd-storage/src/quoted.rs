//! Text and bytes of unknown content in a message or a table: nothing that a terminal or a spreadsheet would obey.

use std::borrow::Cow;

/// Bytes quoted in one line of a message: printable ASCII, the rest escaped, cut after 32.
#[must_use]
pub fn quoted(bytes: &[u8]) -> String {
    const BYTES_MAX: usize = 32;
    let mut text: String = bytes[..bytes.len().min(BYTES_MAX)].escape_ascii().to_string();
    if bytes.len() > BYTES_MAX {
        text.push('…');
    }
    text
}

/// Text on one line of a terminal: control characters, and those that turn the direction of writing, are escaped.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    let is_obeyed = |c: char| {
        c.is_control()
            || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    if !text.contains(is_obeyed) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_obeyed(c) {
            escaped.extend(c.escape_default());
        } else {
            escaped.push(c);
        }
    }
    Cow::Owned(escaped)
}

/// A number as a cell holds it: the shortest text that reads back as the same, with an exponent where it is tiny.
#[must_use]
pub fn number_cell(number: f64) -> String {
    if number != 0.0 && number.abs() < TINY {
        format!("{number:e}")
    } else {
        number.to_string()
    }
}

/// Below this a number would be a row of zeros.
const TINY: f64 = 1e-6;

/// Text for a cell of a table: one that a spreadsheet would compute begins with an apostrophe.
#[must_use]
pub fn no_formula(text: &str) -> Cow<'_, str> {
    if text.starts_with(['=', '+', '-', '@', '\t', '\r']) {
        Cow::Owned(format!("'{text}"))
    } else {
        Cow::Borrowed(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_in_a_cell_reads_back_as_it_was() {
        for (number, text) in [
            (0.0, "0"),
            (-1.5, "-1.5"),
            (1e-300, "1e-300"),
            (-2.5e-7, "-2.5e-7"),
            (1e-6, "0.000001"),
        ] {
            assert_eq!(number_cell(number), text);
            assert_eq!(text.parse::<f64>().unwrap().to_bits(), f64::to_bits(number));
        }
    }

    #[test]
    fn what_would_be_obeyed_is_escaped_and_the_rest_stays() {
        assert_eq!(printable("Wälzlager 3 °C"), "Wälzlager 3 °C");
        assert_eq!(
            printable("a\u{1b}[31m\r\n\u{9b}\u{202e}b"),
            "a\\u{1b}[31m\\r\\n\\u{9b}\\u{202e}b"
        );
        assert_eq!(no_formula("=1+1"), "'=1+1");
        assert_eq!(no_formula("ema0"), "ema0");
    }
}

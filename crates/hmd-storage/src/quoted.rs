//! Bytes of unknown content in a message.

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

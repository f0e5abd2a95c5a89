//! Bytes of unknown content in a message.

/// Bytes as they can be shown in one line of a message: printable ASCII, the rest escaped, cut after 32.
#[must_use]
pub fn shown(bytes: &[u8]) -> String {
    const MOST: usize = 32;
    let mut text: String = bytes[..bytes.len().min(MOST)].escape_ascii().to_string();
    if bytes.len() > MOST {
        text.push('…');
    }
    text
}

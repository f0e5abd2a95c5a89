//! A checksum for metadata records, which MCAP gives none.

use std::collections::BTreeMap;

use sha2::{Digest, Sha256};

/// Key of the checksum.
pub const SEAL: &str = "sha256";

/// Adds the checksum of all other entries under [`SEAL`].
pub fn seal(metadata: &mut BTreeMap<String, String>) {
    metadata.insert(SEAL.to_owned(), checksum(metadata));
}

/// Whether the checksum under [`SEAL`] is there and right.
#[must_use]
pub fn is_sealed(metadata: &BTreeMap<String, String>) -> bool {
    metadata.get(SEAL).is_some_and(|found| *found == checksum(metadata))
}

/// SHA-256 in hex of all entries but the checksum: each text with its length before it, in the order of the keys.
fn checksum(metadata: &BTreeMap<String, String>) -> String {
    let mut sum = Sha256::new();
    for text in metadata
        .iter()
        .filter(|(key, _)| *key != SEAL)
        .flat_map(|(key, value)| [key, value])
    {
        sum.update((text.len() as u64).to_le_bytes());
        sum.update(text);
    }
    hex(&sum.finalize())
}

/// Bytes as hexadecimal digits.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_entry_breaks_the_seal() {
        let mut metadata = BTreeMap::from([("a".to_owned(), "1".to_owned()), ("b".to_owned(), "2".to_owned())]);
        assert!(!is_sealed(&metadata));
        seal(&mut metadata);
        assert!(is_sealed(&metadata));
        let mut other = metadata.clone();
        other.insert("a".to_owned(), "2".to_owned());
        assert!(!is_sealed(&other));
        other = metadata.clone();
        other.remove("b");
        assert!(!is_sealed(&other));
    }
}

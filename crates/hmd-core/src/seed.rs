//! One seed out of several numbers, so that no two suites, actuators or windows share a random stream.

/// SplitMix64 steps over `seed` and the parts.
#[must_use]
pub fn mix(seed: u64, parts: &[u64]) -> u64 {
    let mut x = seed;
    for &part in parts {
        x = x.wrapping_add(part).wrapping_add(0x9E37_79B9_7F4A_7C15);
        x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        x ^= x >> 31;
    }
    x
}

/// A number for a name (FNV-1a), so that what belongs to it does not depend on which others there are.
#[must_use]
pub fn name_hash(name: &str) -> u64 {
    name.bytes().fold(0xCBF2_9CE4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
    })
}

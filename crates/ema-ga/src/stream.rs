//! One random stream per (seed, generation, individual).
//!
//! Seed, generation and individual determine the numbers of a stream, independent of the numbers drawn before and of the
//! thread. A stream is ChaCha8 with the seed as key and (generation, individual) as nonce: nonces give independent key
//! streams by construction, which reseeding a generator does not.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Index of the stream for draws of the whole generation, such as selection.
pub const WHOLE_GENERATION: u32 = u32::MAX;

/// The random stream of one individual, from its start.
///
/// ```
/// use ema_ga::stream::stream;
/// use rand::Rng;
///
/// assert_eq!(stream(7, 3, 17).next_u64(), stream(7, 3, 17).next_u64());
/// assert_ne!(stream(7, 3, 17).next_u64(), stream(7, 17, 3).next_u64());
/// ```
#[must_use]
pub fn stream(seed: u64, generation: u32, individual: u32) -> ChaCha8Rng {
    // The seed is the start of the key itself, so the bits do not depend on how `rand` expands a `u64`.
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    let mut rng = ChaCha8Rng::from_seed(key);
    rng.set_stream(u64::from(generation) << 32 | u64::from(individual));
    rng
}

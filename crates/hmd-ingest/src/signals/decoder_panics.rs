//! Panics of a decoder at a damaged file: they are damage, and nothing else hears of them.

use std::cell;
use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::sync::Once;

thread_local! {
    /// Whether a panic of this thread is a decoder's that gave up: it is reported as damage of the file, not by itself.
    static IS_DECODING: cell::Cell<bool> = const { cell::Cell::new(false) };
}

/// Lets the hook for panics that is there hear of all but those of decoders.
static HOOK: Once = Once::new();

/// What a decoder finds, or that it gave up.
pub(super) fn guarded<T>(decode: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    HOOK.call_once(|| {
        let others = panic::take_hook();
        panic::set_hook(Box::new(move |about| {
            if !IS_DECODING.get() {
                others(about);
            }
        }));
    });
    let was_decoding = IS_DECODING.replace(true);
    // What it was at is dropped, or never used again.
    let found = catch_unwind(AssertUnwindSafe(decode));
    IS_DECODING.set(was_decoding);
    found.unwrap_or_else(|_| Err("damage that its decoder gave up at".to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decoder_that_gives_up_is_damage_and_the_next_panic_is_told_again() {
        let found: Result<(), String> = guarded(|| panic!("a decoder"));
        assert_eq!(found, Err("damage that its decoder gave up at".to_owned()));
        assert!(!IS_DECODING.get());
        let nested = guarded(|| guarded(|| Ok(1)).map(|one| (one, IS_DECODING.get())));
        assert_eq!(nested, Ok((1, true)));
    }
}

//! Values that are needed in several passes over a window.
//!
//! A host keeps them, a controller has no room and makes them again, in the same way: the numbers are the same.

/// Values by place, made in ascending order.
pub(super) struct Kept<T> {
    #[cfg(feature = "std")]
    values: std::vec::Vec<T>,
    /// Values that there is room for: all or none.
    #[cfg(feature = "std")]
    room: usize,
    #[cfg(not(feature = "std"))]
    none: core::marker::PhantomData<T>,
}

/// Most values that are kept, some 300 bytes each: of a window of 8 s at 2 kHz 5 MB, of as many samples at 400 Hz, for which two kinds are kept,
/// 11 MB, in each thread. Those of longer windows are made again in each pass.
#[cfg(feature = "std")]
const KEPT_MAX: usize = 16_384;

#[cfg(feature = "std")]
impl<T> Kept<T> {
    /// Of so many values, none made yet.
    pub(super) fn new(count: usize) -> Self {
        Self {
            values: std::vec::Vec::new(),
            room: if count <= KEPT_MAX { count } else { 0 },
        }
    }

    /// Of values that cost less to make than to keep: none is kept.
    pub(super) fn none() -> Self {
        Self::new(0)
    }

    /// Uses the value of a place; those before it are made already.
    pub(super) fn with<R>(&mut self, place: usize, make: impl FnOnce() -> T, using: impl FnOnce(&T) -> R) -> R {
        if let Some(value) = self.values.get(place) {
            return using(value);
        }
        if self.room == 0 {
            return using(&make());
        }
        if place == 0 {
            self.values.reserve_exact(self.room);
        }
        self.values.push(make());
        using(&self.values[place])
    }

    /// Forgets all values.
    pub(super) fn clear(&mut self) {
        self.values.clear();
    }
}

#[cfg(not(feature = "std"))]
impl<T> Kept<T> {
    /// Of so many values, none made yet.
    pub(super) fn new(_: usize) -> Self {
        Self::none()
    }

    /// Of values that cost less to make than to keep: none is kept.
    pub(super) fn none() -> Self {
        Self {
            none: core::marker::PhantomData,
        }
    }

    /// Uses the value of a place; those before it are made already.
    pub(super) fn with<R>(&mut self, _: usize, make: impl FnOnce() -> T, using: impl FnOnce(&T) -> R) -> R {
        using(&make())
    }
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::*;

    #[test]
    fn values_are_made_once_where_there_is_room() {
        for (count, expected) in [(3, 3), (KEPT_MAX + 1, 6)] {
            let (mut kept, mut made) = (Kept::new(count), 0);
            for place in (0..3).chain(0..3) {
                let make = || {
                    made += 1;
                    10 * place
                };
                assert_eq!(kept.with(place, make, |value| *value), 10 * place);
            }
            assert_eq!(made, expected);
        }
    }
}

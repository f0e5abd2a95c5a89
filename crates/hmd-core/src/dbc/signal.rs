//! [`Signal`]: where a value lies in the data bytes, and what its bits mean.

use serde::Serialize;

/// Bits of a frame: the least significant first (Intel) or the most significant first (Motorola).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Layout {
    /// Bit as DBC numbers it, `8 · byte + bit` with bit 0 the least significant: that of the least significant bit with
    /// Intel order, of the most significant with Motorola order.
    pub start: u16,
    /// Number of bits, 1 to 64.
    pub size: u16,
    /// Motorola order.
    pub big_endian: bool,
}

/// What the bits are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SignalKind {
    /// A whole number.
    Unsigned,
    /// A whole number in two's complement.
    Signed,
    /// IEEE 754, 32 bits.
    F32,
    /// IEEE 754, 64 bits.
    F64,
}

/// A multiplexor and the values at which a signal is there.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Selector {
    /// Where the multiplexor is; an unsigned number.
    pub multiplexor: Layout,
    /// First and last value of each range.
    pub ranges: Vec<(u64, u64)>,
}

/// One signal of a message.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Signal {
    /// Where its bits are.
    pub layout: Layout,
    /// What they are.
    pub kind: SignalKind,
    /// Physical value of one step, and of zero.
    pub factor: f64,
    /// See `factor`.
    pub offset: f64,
    /// Multiplexors that must all select it; none: it is always there.
    pub selectors: Vec<Selector>,
}

impl Layout {
    /// Place of the most significant bit, counted from the first bit of the frame as it is sent; Motorola order.
    fn first_sent(self) -> usize {
        let start = usize::from(self.start);
        start - start % 8 + 7 - start % 8
    }

    /// First and last byte that it touches.
    fn bytes(self) -> (usize, usize) {
        let (start, size) = (usize::from(self.start), usize::from(self.size));
        let first_bit = if self.big_endian { self.first_sent() } else { start };
        (first_bit / 8, (first_bit + size.max(1) - 1) / 8)
    }

    /// Whether it lies within `length` bytes, and has 1 to 64 bits.
    #[must_use]
    pub fn fits(self, length: usize) -> bool {
        (1..=64).contains(&self.size) && self.bytes().1 < length
    }

    /// Its bits as a number; `None` if the data are too short.
    ///
    /// ```
    /// use hmd_core::dbc::Layout;
    /// let intel = Layout { start: 4, size: 12, big_endian: false };
    /// assert_eq!(intel.raw(&[0x5a, 0x34]), Some(0x345));
    /// let motorola = Layout { start: 3, size: 12, big_endian: true };
    /// assert_eq!(motorola.raw(&[0xa5, 0x34]), Some(0x534));
    /// ```
    #[must_use]
    pub fn raw(self, data: &[u8]) -> Option<u64> {
        if !self.fits(data.len()) {
            return None;
        }
        let (first, last) = self.bytes();
        let touched = &data[first..=last];
        // Nine bytes at most.
        let append = |sum: u128, &byte: &u8| sum << 8 | u128::from(byte);
        let (all, below) = if self.big_endian {
            let end = self.first_sent() + usize::from(self.size);
            (touched.iter().fold(0, append), (8 - end % 8) % 8)
        } else {
            (touched.iter().rev().fold(0, append), usize::from(self.start) % 8)
        };
        let mask = u64::MAX >> (64 - u32::from(self.size));
        Some((all >> below) as u64 & mask)
    }
}

impl Selector {
    /// Whether the multiplexor has one of the values.
    #[must_use]
    pub fn selects(&self, data: &[u8]) -> bool {
        let value = self.multiplexor.raw(data);
        value.is_some_and(|value| self.ranges.iter().any(|&(first, last)| (first..=last).contains(&value)))
    }
}

impl Signal {
    /// Whether the multiplexors of this frame select it.
    #[must_use]
    pub fn is_in(&self, data: &[u8]) -> bool {
        self.selectors.iter().all(|selector| selector.selects(data))
    }

    /// Its physical value, `raw · factor + offset`; `None` if the frame does not have it. Floats may be anything.
    #[must_use]
    pub fn value(&self, data: &[u8]) -> Option<f64> {
        if !self.is_in(data) {
            return None;
        }
        let raw = self.layout.raw(data)?;
        let number = match self.kind {
            SignalKind::Unsigned => raw as f64,
            SignalKind::Signed => self.signed(raw) as f64,
            SignalKind::F32 => f64::from(f32::from_bits(raw as u32)),
            SignalKind::F64 => f64::from_bits(raw),
        };
        Some(number * self.factor + self.offset)
    }

    /// A raw number with its sign.
    #[must_use]
    pub fn signed(&self, raw: u64) -> i64 {
        let unused = 64 - u32::from(self.layout.size);
        (raw << unused).cast_signed() >> unused
    }

    /// Difference of physical values after which a whole number begins again, `2^bits · |factor|`; `None` of a float.
    #[must_use]
    pub fn range(&self) -> Option<f64> {
        let whole = matches!(self.kind, SignalKind::Unsigned | SignalKind::Signed);
        whole.then(|| f64::powi(2.0, i32::from(self.layout.size)) * self.factor.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Bit by bit, as the format describes it.
    fn slowly(layout: Layout, data: &[u8]) -> u64 {
        let mut bit = usize::from(layout.start);
        let mut raw = 0;
        for n in 0..layout.size {
            let one = u64::from(data[bit / 8] >> (bit % 8) & 1);
            if layout.big_endian {
                raw = raw << 1 | one;
                bit = if bit.is_multiple_of(8) { bit + 15 } else { bit - 1 };
            } else {
                raw |= one << n;
                bit += 1;
            }
        }
        raw
    }

    proptest! {
        #[test]
        fn bits_are_found_as_one_by_one(
            data in prop::collection::vec(any::<u8>(), 1..=64),
            start in 0..512_u16,
            size in 0..70_u16,
            big_endian: bool,
        ) {
            let layout = Layout { start, size, big_endian };
            match layout.raw(&data) {
                Some(raw) => prop_assert_eq!(raw, slowly(layout, &data)),
                None => prop_assert!(!layout.fits(data.len())),
            }
        }
    }
}

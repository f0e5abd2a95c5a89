//! The last samples of a stream under the kernel.

use super::kernel::MAX_SPAN;

/// As many of the last samples as the kernel spans, `M` quantities each.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sliding<const M: usize> {
    ring: [[f64; M]; MAX_SPAN],
    span: usize,
    /// Place of the oldest sample, which the next one replaces.
    oldest: usize,
    /// Usable samples since the last unusable one.
    usable: usize,
}

impl<const M: usize> Sliding<M> {
    /// An empty ring for this many samples.
    #[must_use]
    pub(super) fn new(span: usize) -> Self {
        Self {
            ring: [[0.0; M]; MAX_SPAN],
            span: span.min(MAX_SPAN),
            oldest: 0,
            usable: 0,
        }
    }

    /// Appends a sample.
    pub(super) fn push(&mut self, sample: [f64; M]) {
        self.ring[self.oldest] = sample;
        self.oldest = (self.oldest + 1) % self.span;
        self.usable += 1;
    }

    /// Forgets all samples: none before this instant may share a kernel with one after it.
    pub(super) fn clear(&mut self) {
        self.usable = 0;
    }

    /// Whether the samples fill the span.
    #[must_use]
    pub(super) fn is_full(&self) -> bool {
        self.usable >= self.span
    }

    /// The samples with the weights of their places, oldest first.
    fn weighted<'a, W>(
        &'a self,
        weights: &'a [W; MAX_SPAN],
    ) -> [core::iter::Zip<core::slice::Iter<'a, W>, core::slice::Iter<'a, [f64; M]>>; 2] {
        let (later, earlier) = self.ring[..self.span].split_at(self.oldest);
        let (first, second) = weights[..self.span].split_at(earlier.len());
        [first.iter().zip(earlier), second.iter().zip(later)]
    }

    /// Sums of all quantities with one set of weights, oldest sample first; samples not yet pushed are zero.
    #[must_use]
    pub(super) fn sums(&self, weights: &[f64; MAX_SPAN]) -> [f64; M] {
        let mut sums = [0.0; M];
        // Two loops, not a chain: the inner one becomes vector instructions.
        for half in self.weighted(weights) {
            for (weight, sample) in half {
                for m in 0..M {
                    sums[m] += weight * sample[m];
                }
            }
        }
        sums
    }

    /// Sums of all quantities, each with one of several sets of weights, oldest sample first.
    #[must_use]
    pub(super) fn weighted_sums<const K: usize>(&self, weights: &[[f64; K]; MAX_SPAN], set_of: [usize; M]) -> [f64; M] {
        let mut sums = [0.0; M];
        for half in self.weighted(weights) {
            for (weights, sample) in half {
                for m in 0..M {
                    sums[m] += weights[set_of[m]] * sample[m];
                }
            }
        }
        sums
    }

    /// Sums of some quantities with one set of weights, oldest sample first.
    #[must_use]
    pub(super) fn sums_of<const K: usize>(&self, quantities: [usize; K], weights: &[f64; MAX_SPAN]) -> [f64; K] {
        let mut sums = [0.0; K];
        for half in self.weighted(weights) {
            for (weight, sample) in half {
                for (sum, quantity) in sums.iter_mut().zip(quantities) {
                    *sum += weight * sample[quantity];
                }
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_apply_oldest_first_to_the_last_samples() {
        let mut ring = Sliding::<2>::new(3);
        let mut weights = [0.0; MAX_SPAN];
        weights[..3].copy_from_slice(&[1.0, 10.0, 100.0]);
        for n in 0..5 {
            assert_eq!(ring.is_full(), n >= 3);
            ring.push([f64::from(n), -1.0]);
        }
        assert_eq!(ring.sums(&weights).map(|sum| sum as i32), [432, -111]);
        assert_eq!(ring.sums_of([1], &weights).map(|sum| sum as i32), [-111]);
        let of_each = weights.map(|weight| [weight, 2.0 * weight]);
        assert_eq!(ring.weighted_sums(&of_each, [0, 1]).map(|sum| sum as i32), [432, -222]);
        ring.clear();
        assert!(!ring.is_full());
    }
}

//! Boxes and random streams of the minimisers, seeds of the suites.

use crate::{MANY, SOME, for_any};
use ema_ga::Bounds;
use ema_ga::stream::stream;
use hmd_core::seed::mix;
use rand::Rng;

/// A box that is accepted has its corners in order, and clamps every number into it.
///
/// Any doubles in two dimensions.
#[test]
fn clamped_genes_are_in_the_box() {
    for_any!(MANY, |input: ([u64; 2], [u64; 2], [u64; 2])| {
        let [lower, upper, genes] = [input.0, input.1, input.2].map(|bits| bits.map(f64::from_bits));
        if let Ok(bounds) = Bounds::new(lower, upper) {
            assert!((0..2).all(|gene| bounds.width(gene) > 0.0 && bounds.width(gene).is_finite()));
            assert!(genes.iter().any(|gene| gene.is_nan()) || bounds.contains(&bounds.clamp(genes)));
        }
    });
}

/// Individuals of one seed have streams of their own.
///
/// Any two of (generation, individual).
#[test]
fn no_two_individuals_share_a_stream() {
    for_any!(SOME, |input: (u64, [u32; 2], [u32; 2])| {
        let (seed, one, two) = input;
        let first = |[generation, individual]: [u32; 2]| {
            let mut stream = stream(seed, generation, individual);
            [stream.next_u64(), stream.next_u64()]
        };
        assert_eq!(first(one) == first(two), one == two);
    });
}

/// Seeds of windows of one actuator differ.
///
/// Any seed, windows 0 to 999.
#[test]
fn no_two_windows_share_a_seed() {
    for_any!(20, |seed: u64| {
        let mut seeds: Vec<_> = (0..1000).map(|window| mix(seed, &[7, window])).collect();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 1000);
    });
}

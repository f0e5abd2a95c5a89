//! The step of a sensor, from the values that it gave.

/// Values that show a step.
const VALUES_MIN: usize = 20;

/// Largest probability that values lie on a grid by chance.
const CHANCE_MAX: f64 = 1e-12;

/// Changes of how many steps there are from sample to sample. Samples of an even motion lie on a grid of their own, whose number is the same
/// throughout.
const CHANGES_MIN: usize = 10;

/// Narrowest step that is told from the resolution, in units of it: below, too many values are near a multiple.
const STEP_MIN: f64 = 4.0;

/// Largest error of a difference, in units: two values, each off by half a unit, with what the arithmetic leaves.
const ERROR: f64 = 1.001;

/// Candidates after which the values lie too far apart for what they span.
const CANDIDATES_MAX: usize = 100_000;

/// The step of a signal whose values come rounded to whole `unit`s, in the signal's unit: the largest of which all their differences are
/// multiples, else the unit. 0 where they do not tell: few, so that chance may have done it, far apart, or of an even motion.
///
/// Each difference D to a value of the closest pair is k d ± 1 unit, so d lies between (D − 1)/k and (D + 1)/k: from the nearest value
/// to the farthest, every k that leaves something of the interval is followed. Derived here.
pub(crate) fn step_width(values: &[f64], unit: f64) -> f64 {
    let values: Vec<f64> = values.iter().map(|value| value / unit).collect();
    let mut distinct = values.clone();
    distinct.sort_by(f64::total_cmp);
    distinct.dedup_by(|a, b| (*a - *b).abs() < 0.1);
    if distinct.len() < VALUES_MIN {
        return 0.0;
    }
    let closest = distinct
        .windows(2)
        .min_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])));
    let origin = closest.map_or(0.0, |pair| pair[0]);
    let mut distances: Vec<f64> = distinct.iter().map(|value| (value - origin).abs()).collect();
    distances.sort_by(f64::total_cmp);
    match divisor(&distances[1..]) {
        Divisor::Unknown => 0.0,
        Divisor::Of(step) if (2.0 * ERROR / step).powi(distances.len() as i32) > CHANCE_MAX => 0.0,
        Divisor::Of(step) if is_even(&values, step) => 0.0,
        Divisor::Of(step) => step * unit,
        Divisor::None => unit,
    }
}

/// Of which some numbers are multiples but for their errors.
enum Divisor {
    Of(f64),
    None,
    Unknown,
}

/// The largest of at least [`STEP_MIN`] of which all distances, the least first, are multiples but for their errors.
fn divisor(distances: &[f64]) -> Divisor {
    let mut open = vec![(0, STEP_MIN, f64::INFINITY)];
    let mut candidates = 0_usize;
    while let Some((n, least, most)) = open.pop() {
        let Some(distance) = distances.get(n) else {
            return Divisor::Of(0.5 * (least + most));
        };
        let (from, to) = ((distance - ERROR) / most, (distance + ERROR) / least);
        let (from, to) = (from.ceil().max(1.0) as usize, to.floor() as usize);
        candidates = to.saturating_sub(from).saturating_add(candidates + 1);
        if candidates > CANDIDATES_MAX {
            return Divisor::Unknown;
        }
        // The last is taken first: the widest step.
        open.extend((from..=to).rev().filter_map(|k| {
            let [low, high] = [-ERROR, ERROR].map(|error| (distance + error) / k as f64);
            let (least, most) = (least.max(low), most.min(high));
            (least <= most).then_some((n + 1, least, most))
        }));
    }
    Divisor::None
}

/// Whether the number of steps from sample to sample hardly changes.
fn is_even(values: &[f64], step: f64) -> bool {
    let steps: Vec<f64> = values
        .windows(2)
        .map(|two| ((two[1] - two[0]) / step).round())
        .collect();
    let changes = steps.windows(2).filter(|two| two[0].total_cmp(&two[1]).is_ne());
    changes.count() < CHANGES_MIN
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Angles of a motion of some samples in counts: from rest over a span and back to rest, as read in steps of so many counts.
    fn motion(samples: u32, span: f64, step: f64) -> Vec<f64> {
        let read = |n: u32| {
            let x = f64::from(n) / f64::from(samples);
            let angle = span * (x - (std::f64::consts::TAU * x).sin() / std::f64::consts::TAU)
                + 0.013 * span * (29.0 * x).sin();
            ((angle / step).floor() * step).round()
        };
        (0..samples).map(read).collect()
    }

    fn assert_step(values: &[f64], unit: f64, expected: f64, what: &str) {
        let found = step_width(values, unit);
        assert!(
            (found - expected).abs() < 0.01 * expected + 1e-12,
            "{what}: {found}, not {expected}"
        );
    }

    #[test]
    fn samples_far_apart_have_the_step_of_their_sensor() {
        for bits in [16, 20, 23, 24] {
            let span = 3.6 * f64::from(1_u32 << bits);
            for samples in [120, 220, 1000, 4000] {
                assert_step(
                    &motion(samples, span, 1.0),
                    1.0,
                    1.0,
                    &format!("{bits} bits, {samples} samples"),
                );
            }
        }
    }

    #[test]
    fn a_coarser_sensor_is_told_however_far_apart_its_samples_lie() {
        let span = 3.6 * 65_536.0;
        for step in [4.0, 10.43, 16.0, 97.3, 256.0] {
            for samples in [120, 220, 1000, 4000] {
                assert_step(
                    &motion(samples, span, step),
                    1.0,
                    step,
                    &format!("{step}, {samples} samples"),
                );
            }
        }
        // Few values of a wide step.
        assert_step(&motion(400, 1500.0, 50.0), 1.0, 50.0, "30 values");
        // Of 12 bit and 16 A, in mA.
        let currents: Vec<f64> = motion(400, 8_000.0, 7.8125)
            .iter()
            .map(|current| 1e-3 * current)
            .collect();
        assert_step(&currents, 1e-3, 7.8125e-3, "currents");
    }

    #[test]
    fn an_even_motion_and_few_values_tell_no_step() {
        let even: Vec<f64> = (0..400).map(|n| (475.3 * f64::from(n)).round()).collect();
        assert!(step_width(&[vec![0.0; 100], even].concat(), 1.0).abs() < f64::EPSILON);
        assert!(step_width(&[0.0; 400], 1.0).abs() < f64::EPSILON, "it stands");
        assert!(step_width(&motion(400, 15.0, 1.0), 1.0).abs() < f64::EPSILON, "few");
        for odd in [f64::NAN, f64::INFINITY, f64::MAX] {
            let _ = step_width(&[motion(400, 4000.0, 1.0), vec![odd, -odd]].concat(), 1.0);
        }
    }
}

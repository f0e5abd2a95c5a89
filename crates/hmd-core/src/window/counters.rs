//! Spikes and jumps of a counter.
//!
//! A count is compared with straight lines through the two good counts before it and the two after it. The torque bounds
//! the motor's acceleration, hence how far a genuine count lies off both lines on the same side. A hard stop or the meeting
//! of teeth is a kink, which lies on one of the two lines; a spike lies on neither.

use super::quality::{Defect, Part};
use super::ring::Slot;
use ema_models::SensedSample;

/// What a counter can do, in counts and sample periods.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CounterLimits {
    pub(super) part: Part,
    pub(super) defect: Defect,
    /// Counts in one period at the highest possible speed.
    pub(super) speed: f64,
    /// Counts per period, per period, at the highest acceleration.
    pub(super) acceleration: f64,
    /// Largest time by which a sample of the window is taken early or late, periods.
    pub(super) jitter: f64,
}

/// Deviation that is always allowed, counts: noise and rounding of a counter.
const SLACK: f64 = 8.0;

/// Longest run of spikes that is looked for.
const RUN: usize = 2;

/// Times the counts are searched again after spikes were taken out; more of them make the window invalid anyway.
const PASSES: usize = 4;

/// A good count at its place in the window.
#[derive(Clone, Copy, Debug)]
struct Point {
    index: usize,
    count: f64,
}

/// Refuses spikes; returns the place of the first sample after a jump, if the counter has jumped and stayed there.
pub(super) fn refuse_spikes(slots: &mut [Slot], limits: &CounterLimits) -> Option<usize> {
    let mut points = good_points(slots, limits.part);
    for run in 1..=RUN {
        for _ in 0..PASSES {
            let spikes = off_both_lines(&points, run, limits);
            if spikes.is_empty() {
                break;
            }
            refuse(slots, &mut points, &spikes, limits);
        }
    }
    // After the spikes: seen from a spike, it is the good count after it that is too fast.
    match too_fast(&points, limits) {
        Ok(spikes) => refuse(slots, &mut points, &spikes, limits),
        Err(at) => return Some(at),
    }
    pulse_of_speed(&points, limits)
}

fn good_points(slots: &[Slot], part: Part) -> Vec<Point> {
    let read = |s: &SensedSample| {
        if part == Part::Motor {
            s.motor_counts
        } else {
            s.output_counts
        }
    };
    let origin = slots
        .iter()
        .find(|slot| slot.is_good(part))
        .map_or(0, |slot| read(&slot.sample));
    let good = slots.iter().enumerate().filter(|(_, slot)| slot.is_good(part));
    good.map(|(index, slot)| Point {
        index,
        count: (i128::from(read(&slot.sample)) - i128::from(origin)) as f64,
    })
    .collect()
}

fn refuse(slots: &mut [Slot], points: &mut Vec<Point>, spikes: &[usize], limits: &CounterLimits) {
    for &index in spikes {
        slots[index].refuse(limits.part, limits.defect);
    }
    if !spikes.is_empty() {
        points.retain(|point| slots[point.index].is_good(limits.part));
    }
}

/// Indices that cannot be reached from the good ones before them at the highest speed, or `Err` with the first of two in a
/// row that agree with each other but not with the past: then the counter itself has jumped.
fn too_fast(points: &[Point], limits: &CounterLimits) -> Result<Vec<usize>, usize> {
    let agree = |a: &Point, b: &Point| (b.count - a.count).abs() <= limits.speed * (b.index - a.index) as f64 + SLACK;
    let mut spikes = Vec::new();
    let [first, second, third, ..] = points else {
        return Ok(spikes);
    };
    let mut good = first;
    if !agree(first, second) && agree(second, third) && !agree(first, third) {
        // At the very beginning there is no past: one against two.
        spikes.push(first.index);
        good = second;
    }
    let mut suspect: Option<&Point> = None;
    for point in points.iter().filter(|point| point.index > good.index) {
        if agree(good, point) {
            (good, suspect) = (point, None);
        } else if let Some(suspect) = suspect.filter(|suspect| agree(suspect, point)) {
            return Err(suspect.index);
        } else {
            spikes.push(point.index);
            suspect = Some(point);
        }
    }
    Ok(spikes)
}

/// Factor on the jitter that the window's median shows: instants that do not jitter evenly reach further.
const JITTER_MARGIN: f64 = 1.25;

/// Two counts, of which the first is the nearer one.
type Line<'a> = (&'a Point, &'a Point);

/// Counts per period along a line.
fn slope((near, far): Line<'_>) -> f64 {
    (near.count - far.count) / (near.index as f64 - far.index as f64)
}

/// Deviation allowed from a line at the speed `speed`: twice the acceleration's, and what the counter turns while the instants of
/// the three counts jitter.
fn allowed(point: &Point, (near, far): Line<'_>, speed: f64, limits: &CounterLimits) -> f64 {
    let steps = point.index.abs_diff(far.index) - 1;
    let beyond = point.index.abs_diff(near.index) as f64 / near.index.abs_diff(far.index) as f64;
    let instants = 2.0 * (1.0 + beyond) * JITTER_MARGIN * limits.jitter;
    SLACK + limits.acceleration * (steps * (steps + 1)) as f64 + instants * speed
}

/// Indices of runs of `run` counts that lie off the line before and the line after, on the same side. Where there are no
/// two counts on one side, the other side decides.
fn off_both_lines(points: &[Point], run: usize, limits: &CounterLimits) -> Vec<usize> {
    let mut spikes = vec![false; points.len()];
    // The first two, which have no line before them, come last and from the inside out, so that no spike behind them decides.
    for place in (2..points.len()).chain([1, 0]) {
        let Some(judged) = points.get(place..place + run) else {
            continue;
        };
        // The neighbours of a spike are judged in the next pass, without it.
        let neighbours = place.saturating_sub(2)..(place + run + 2).min(points.len());
        if spikes[neighbours].contains(&true) {
            continue;
        }
        let before = place.checked_sub(2).map(|far| (&points[far + 1], &points[far]));
        let after = points.get(place + run + 1).map(|far| (&points[place + run], far));
        // The counts in question are not among those that tell the speed.
        let slopes = [before, after].into_iter().flatten().map(|line| slope(line).abs());
        let speed = slopes.fold(0.0, f64::max);
        let is_spike = judged.iter().all(|point| {
            let off = [before, after].map(|line| line.map(|line| off_line(point, line, speed, limits)));
            match off {
                [Some(left), Some(right)] => left * right > 0.0 && left.abs().min(right.abs()) > 1.0,
                [Some(only), None] | [None, Some(only)] => only.abs() > 1.0,
                [None, None] => false,
            }
        });
        if is_spike {
            spikes[place..place + run].fill(true);
        }
    }
    let places = points.iter().zip(spikes);
    places
        .filter_map(|(point, is_spike)| is_spike.then_some(point.index))
        .collect()
}

/// Signed distance of a count from the line through two others on one side of it, as a multiple of what is allowed.
fn off_line(point: &Point, line: Line<'_>, speed: f64, limits: &CounterLimits) -> f64 {
    let near = line.0;
    let expected = near.count + slope(line) * (point.index as f64 - near.index as f64);
    (point.count - expected) / allowed(point, line, speed, limits)
}

/// First index after an interval whose speed sticks out from those before and after it: a jump that the speed limit lets
/// pass.
fn pulse_of_speed(points: &[Point], limits: &CounterLimits) -> Option<usize> {
    points.windows(4).find_map(|p| {
        let (left, right) = ((&p[1], &p[0]), (&p[2], &p[3]));
        let speed = slope(left).abs().max(slope(right).abs());
        let (left, right) = (
            off_line(&p[2], left, speed, limits),
            off_line(&p[1], right, speed, limits),
        );
        // Seen from the left the count after the jump is high, seen from the right the one before it is low.
        (left * right < 0.0 && left.abs().min(right.abs()) > 1.0).then_some(p[2].index)
    })
}

#[cfg(test)]
mod tests;

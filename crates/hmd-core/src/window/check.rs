//! Whether the samples of a window are fit for an assessment: refuses single samples, then decides on the window.

use super::config::{CLOCK_JUMP_S, Lengths, SCATTERED_RUN};
use super::counters::{CounterLimits, refuse_spikes};
use super::held::or_held;
use super::jitter::{sample_jitter, time_jitter};
use super::limits::Limits;
use super::quality::{Counter, Defect, Degradation, Invalidity, Part, Signal};
use super::ring::Slot;
use super::signals::{one_current_stuck, refuse_currents, refuse_repeated, stuck};
use super::trigger::{Thresholds, value};
use ema_models::Setpoint;

/// What was found in the samples of one window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Findings {
    pub(super) lost: u64,
    pub(super) rejected: u64,
    pub(super) repeated: u64,
    pub(super) clock_jumps: u64,
    /// Speed by which the motor missed its setpoint before the trigger, rad/s, if it is a handicap.
    pub(super) unsteady_rad_s: Option<f64>,
    /// Jitter of the stamps, where they number the samples, as a share of a period.
    pub(super) time_jitter: Option<f64>,
    pub(super) invalid: Option<Invalidity>,
}

impl Findings {
    /// The handicaps of a window that is fit; `another` is the sample at which another actuation begins.
    pub(super) fn degradations(&self, is_filled: bool, another: Option<u64>) -> Vec<Degradation> {
        let filled = is_filled.then_some(Degradation::Filled {
            lost: self.lost,
            rejected: self.rejected,
        });
        let repeated = (self.repeated > 0).then_some(Degradation::Repeated(self.repeated));
        let another = another.map(|at| Degradation::AnotherActuation { at: at as usize });
        let unsteady = self
            .unsteady_rad_s
            .map(|speed_rad_s| Degradation::UnsteadyStart { speed_rad_s });
        let jitter = self.time_jitter.map(|of_period| Degradation::TimeJitter { of_period });
        let all = [filled, repeated, another, unsteady, jitter];
        all.into_iter().flatten().collect()
    }
}

/// Refuses samples that cannot be used and decides whether the rest is enough; of several reasons, the first in the order below.
pub(super) fn examine(slots: &mut [Slot], limits: &Limits) -> Findings {
    refuse_repeated(slots, limits);
    refuse_currents(slots, limits);
    let jitter = sample_jitter(slots);
    let jumps = [(limits.motor, Counter::Motor), (limits.output, Counter::Output)].map(|(of, counter)| {
        refuse_spikes(slots, &CounterLimits { jitter, ..of }).map(|at| Invalidity::CounterJumped { counter, at })
    });
    let lost = slots.iter().filter(|slot| !slot.was_received()).count() as u64;
    let rejected = slots
        .iter()
        .filter(|slot| slot.was_received() && slot.is_flawed())
        .count() as u64;
    let (clock_jumps, rate) = clock(slots, limits);
    let time_jitter = limits
        .is_numbered_by_time
        .then(|| time_jitter(slots, limits.sample_rate));
    let invalid = rate
        .or_else(|| one_current_stuck(slots, limits).then_some(Invalidity::Stuck(Signal::Currents)))
        .or_else(|| too_many_flawed(slots, &limits.lengths))
        .or_else(|| command_in_gap(slots, &limits.thresholds))
        .or_else(|| stuck(slots, limits).map(Invalidity::Stuck))
        .or_else(|| jumps.into_iter().flatten().next())
        .or_else(|| counters_disagree(slots, limits))
        .or_else(|| start_in_motion(slots, limits));
    Findings {
        lost,
        rejected,
        repeated: slots
            .iter()
            .filter(|slot| slot.first_defect() == Some(Defect::Repeated))
            .count() as u64,
        clock_jumps,
        unsteady_rad_s: unsteady_start(slots, limits),
        time_jitter,
        invalid: invalid.map(|why| or_time_jitter(or_held(slots, why), time_jitter)),
    }
}

/// Jitter of stamps, as a share of a period, that puts single samples in the wrong place where they number them.
const MISPLACING_JITTER: f64 = 0.15;

/// What makes a window invalid, or the jitter that does so where stamps number the samples.
fn or_time_jitter(why: Invalidity, time_jitter: Option<f64>) -> Invalidity {
    let is_by_places = match why {
        Invalidity::CommandInGap { .. } | Invalidity::CounterJumped { .. } => true,
        Invalidity::TooManyFlawed { defect, .. } => {
            matches!(defect, Defect::Missing | Defect::MotorSpike | Defect::OutputSpike)
        }
        _ => false,
    };
    match time_jitter {
        Some(of_period) if is_by_places && of_period > MISPLACING_JITTER => Invalidity::TimeJitter { of_period },
        _ => why,
    }
}

fn too_many_flawed(slots: &[Slot], lengths: &Lengths) -> Option<Invalidity> {
    let (mut count, mut longest, mut run) = (0, 0, 0);
    let mut by_defect = [0_usize; Defect::ALL.len()];
    for slot in slots {
        if let Some(defect) = slot.first_defect() {
            by_defect[defect as usize] += 1;
            count += 1;
            run += 1;
            longest = longest.max(run);
        } else {
            run = 0;
        }
    }
    let most = if longest <= SCATTERED_RUN {
        lengths.scattered_max
    } else {
        lengths.missing_max
    };
    if count <= most && longest <= lengths.longest_gap {
        return None;
    }
    let most = by_defect.iter().copied().max()?;
    let defect = Defect::ALL
        .into_iter()
        .find(|&defect| by_defect[defect as usize] == most)?;
    Some(Invalidity::TooManyFlawed { defect, count, longest })
}

/// A jump of the command that lies in a gap, bigger than what the steps on either side of the gap explain by more than the
/// trigger threshold and a twentieth of the setpoint's range.
fn command_in_gap(slots: &[Slot], thresholds: &Thresholds) -> Option<Invalidity> {
    let at = |n: usize| {
        slots
            .get(n)
            .filter(|slot| slot.is_good(Part::Setpoint))
            .map(|slot| value(slot.sample.setpoint))
    };
    let good = (0..slots.len()).filter_map(at);
    let (min, max) = good.fold((f64::INFINITY, f64::NEG_INFINITY), |(min, max), x| {
        (min.min(x), max.max(x))
    });
    let tolerated = thresholds
        .jump_at(slots.first()?.sample.setpoint)
        .max(0.05 * (max - min));
    let mut before: Option<(usize, f64)> = None;
    for n in 0..slots.len() {
        let Some(now) = at(n) else { continue };
        if let Some((m, then)) = before
            && n - m > 1
        {
            let step = |a: Option<f64>, b: Option<f64>| a.zip(b).map_or(0.0, |(a, b)| (b - a).abs());
            let step_before = step(m.checked_sub(1).and_then(at), Some(then));
            let slope = step_before.max(step(Some(now), at(n + 1)));
            if (now - then).abs() > slope * (n - m) as f64 + tolerated {
                return Some(Invalidity::CommandInGap { at: n });
            }
        }
        before = Some((n, now));
    }
    None
}

/// Range of the difference between output angle and motor angle over the gear ratio: the play, whatever else is worn.
fn counters_disagree(slots: &[Slot], limits: &Limits) -> Option<Invalidity> {
    let good = |slot: &&Slot| slot.is_good(Part::Motor) && slot.is_good(Part::Output);
    let first = slots.iter().find(good)?.sample;
    let (mut min, mut max) = (0.0_f64, 0.0_f64);
    for Slot { sample, .. } in slots.iter().filter(good) {
        let motor = sample.motor_counts.saturating_sub(first.motor_counts) as f64 * limits.rotor.motor_lsb;
        let output = sample.output_counts.saturating_sub(first.output_counts) as f64 * limits.output_lsb;
        let difference = output - motor / limits.gear_ratio;
        (min, max) = (min.min(difference), max.max(difference));
    }
    (max - min > limits.play_max_rad).then_some(Invalidity::CountersDisagree { range_rad: max - min })
}

/// Range of the motor angle before the trigger, if the setpoint was not held there and the motor turned.
///
/// The turning point of a commanded oscillation looks like rest to the trigger. A window that starts there has an unknown
/// backlash side and integral, which would be identified as wear.
fn start_in_motion(slots: &[Slot], limits: &Limits) -> Option<Invalidity> {
    let rest = slots.get(..limits.lengths.pre_trigger)?;
    let range = |values: &mut dyn Iterator<Item = f64>| {
        let (min, max) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(min, max), x| {
            (min.min(x), max.max(x))
        });
        max - min
    };
    let first = rest.first()?.sample;
    let commanded = range(
        &mut rest
            .iter()
            .filter(|slot| slot.is_good(Part::Setpoint))
            .map(|slot| value(slot.sample.setpoint)),
    );
    let turned_rad = range(
        &mut rest
            .iter()
            .filter(|slot| slot.is_good(Part::Motor))
            .map(|slot| slot.sample.motor_counts.saturating_sub(first.motor_counts) as f64 * limits.rotor.motor_lsb),
    );
    (commanded > limits.thresholds.held(first.setpoint) && turned_rad > limits.still_rad)
        .then_some(Invalidity::StartInMotion { turned_rad })
}

/// Mean speed before the trigger, in speed mode less the setpoint, if it is more than a fifth of ω_max: the speed loop
/// is then at work, and its integrator not known.
fn unsteady_start(slots: &[Slot], limits: &Limits) -> Option<f64> {
    let rest = slots.get(..limits.lengths.pre_trigger)?;
    let good = |slot: &&Slot| slot.is_good(Part::Motor);
    let (first, last) = (rest.iter().find(good)?.sample, rest.iter().rfind(good)?.sample);
    let counts = last.motor_counts.saturating_sub(first.motor_counts) as f64;
    let samples = last.seq.saturating_sub(first.seq).max(1) as f64;
    let speed = counts * limits.rotor.motor_lsb * limits.sample_rate / samples;
    let expected = if let Setpoint::Speed(speed) = first.setpoint {
        speed
    } else {
        0.0
    };
    ((speed - expected).abs() > limits.unsteady_rad_s).then_some(speed - expected)
}

/// Jumps of the stamps against the counter, and whether they advance at another rate than the type's.
///
/// Where the rate is only assumed, stamps that advance at another rate over a window show that it is wrong; every speed and
/// time constant would be wrong with it. Stamps that never advance show nothing. A rate measured by the device's own time
/// needs no such proof: stamps are those of a host, which may have read late, or of a device that runs slower than time.
fn clock(slots: &[Slot], limits: &Limits) -> (u64, Option<Invalidity>) {
    let mut jumps = 0;
    let (mut intervals, mut by_stamps, mut by_counter) = (0, 0.0, 0.0);
    let mut before: Option<&Slot> = None;
    for slot in slots.iter().filter(|slot| slot.was_received()) {
        if let Some(before) = before {
            let stamps = (i128::from(slot.stamp_ns) - i128::from(before.stamp_ns)) as f64 * 1e-9;
            let counter = (slot.sample.seq - before.sample.seq) as f64 / limits.sample_rate;
            intervals += 1;
            if (stamps - counter).abs() > CLOCK_JUMP_S {
                jumps += 1;
            } else {
                by_stamps += stamps;
                by_counter += counter;
            }
        }
        before = Some(slot);
    }
    let enough = by_counter > 0.1 && by_stamps > 0.0 && jumps < 1 + intervals / 10;
    let wrong = enough && f64::abs(by_stamps - by_counter) > 0.1 * by_counter + CLOCK_JUMP_S;
    let rate = Invalidity::SampleRate {
        configured_hz: limits.sample_rate,
        by_stamps_hz: limits.sample_rate * by_counter / by_stamps,
    };
    (jumps, (wrong && limits.rate_is_unconfirmed).then_some(rate))
}

#[cfg(test)]
mod tests;

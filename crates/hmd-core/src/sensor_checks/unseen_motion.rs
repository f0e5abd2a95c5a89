//! Motion without any window: what the trigger saw.
//!
//! A set point in the wrong unit or a mode that is never on triggers no window, and nothing is ever assessed. Here the samples of an
//! actuator that has had no window yet are watched: where its motor turns under current for a minute, or until the traffic ends, a
//! sentence says what the set point and the mode did meanwhile.

use ema_models::{ActuatorParams, SensedSample, Setpoint};

use super::moved::{MotionLimits, Moved};
use super::suspect::Suspect;

/// Time after the first motion that is left for a window, s.
const PATIENCE_S: f64 = 60.0;

/// Ratio of travel and set point that is another unit.
const UNIT_MIN: f64 = 8.0;

/// Watches the samples of one actuator until its first window.
#[derive(Clone, Debug)]
pub struct UnseenMotion {
    limits: MotionLimits,
    period_s: f64,
    /// Since the first sample.
    moved: Option<Moved>,
    angle: Range,
    speed: Range,
    active: u64,
    /// Samples since the motion began.
    since_motion: Option<u64>,
    is_done: bool,
}

/// Smallest and largest value.
#[derive(Clone, Copy, Debug)]
struct Range(f64, f64);

impl Range {
    const NONE: Self = Self(f64::INFINITY, f64::NEG_INFINITY);

    fn add(&mut self, value: f64) {
        *self = Self(self.0.min(value), self.1.max(value));
    }

    fn span(self) -> f64 {
        (self.1 - self.0).max(0.0)
    }
}

impl UnseenMotion {
    /// For an actuator whose windows a set point triggers that moves by `trigger_rad`.
    #[must_use]
    pub fn new(params: &ActuatorParams, trigger_rad: f64) -> Self {
        Self {
            limits: MotionLimits::new(params, trigger_rad),
            period_s: 1.0 / params.sensors.sample_rate,
            moved: None,
            angle: Range::NONE,
            speed: Range::NONE,
            active: 0,
            since_motion: None,
            is_done: false,
        }
    }

    /// A window was cut: the trigger works.
    pub fn end(&mut self) {
        self.is_done = true;
    }

    /// Takes a sample; the sentence where the motion has gone on for a minute.
    pub fn push(&mut self, sample: &SensedSample) -> Option<String> {
        if self.is_done {
            return None;
        }
        let limits = self.limits;
        let moved = self
            .moved
            .get_or_insert_with(|| Moved::since(sample.motor_counts, limits));
        moved.push(sample);
        let is_motion = moved.is_motion();
        match sample.setpoint {
            Setpoint::Idle => {}
            Setpoint::Position(angle) => self.angle.add(angle),
            Setpoint::Speed(speed) => self.speed.add(speed),
        }
        self.active += u64::from(sample.setpoint != Setpoint::Idle);
        if is_motion {
            let samples = self.since_motion.get_or_insert(0);
            *samples += 1;
            if *samples as f64 * self.period_s > PATIENCE_S {
                return self.finish();
            }
        }
        None
    }

    /// End of the traffic, or of the patience: the sentence where there was motion and no window.
    pub fn finish(&mut self) -> Option<String> {
        let moved = self.moved.filter(|moved| !self.is_done && moved.is_motion())?;
        self.is_done = true;
        let travel = moved.travel_rad();
        let seen = format!(
            "no window, while the output turned by {travel:.3} rad with up to {:.1} A",
            moved.current_max_a()
        );
        let commanded = self.angle.span();
        Some(if self.active == 0 {
            format!("{}: {seen}: the mode was never on", Suspect::Mode)
        } else if self.speed.span() > 0.0 {
            format!(
                "{seen}: the set point moved by {:.3} rad/s and did not rest before",
                self.speed.span()
            )
        } else if commanded <= 0.0 {
            format!("{seen}: the set point never moved")
        } else if travel > UNIT_MIN * commanded {
            let times = travel / commanded;
            let unit = Suspect::SetpointUnit;
            format!("{unit}: {seen}: the set point moved by {commanded:.6} rad, {times:.0} times less")
        } else {
            format!("{seen}: the set point moved by {commanded:.3} rad and did not rest before")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said of a motion of 0.2 rad in one second whose set points are these.
    fn said(setpoint: impl Fn(f64) -> Setpoint, current: f64) -> Option<String> {
        let params = ActuatorParams::bench();
        let mut motion = UnseenMotion::new(&params, 1e-3);
        let per_rad = params.transmission.gear_ratio / params.sensors.motor_lsb();
        for seq in 0..2000 {
            let angle = 0.2 * seq as f64 / 2000.0;
            let sample = SensedSample {
                seq,
                currents: [current, -current, 0.0],
                motor_counts: (angle * per_rad) as i64,
                output_counts: 0,
                setpoint: setpoint(angle),
            };
            assert_eq!(motion.push(&sample), None);
        }
        motion.finish()
    }

    #[test]
    fn what_the_trigger_saw_is_said() {
        let idle = said(|_| Setpoint::Idle, 2.0).unwrap();
        assert!(idle.starts_with("mode: no window"), "{idle}");
        let unit = said(|angle| Setpoint::Position(1e-3 * angle), 2.0).unwrap();
        assert!(
            unit.starts_with("set point unit") && unit.ends_with("1000 times less"),
            "{unit}"
        );
        let still = said(|_| Setpoint::Position(0.0), 2.0).unwrap();
        assert!(still.ends_with("never moved"), "{still}");
        let restless = said(Setpoint::Position, 2.0).unwrap();
        assert!(restless.ends_with("did not rest before"), "{restless}");
        // Turned by something else.
        assert_eq!(said(|_| Setpoint::Idle, 0.01), None);
    }
}

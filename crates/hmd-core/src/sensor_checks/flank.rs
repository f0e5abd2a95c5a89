//! The flank that an angle pushes: the direction in which it moves, once it has turned back by enough.

/// Counts of the encoder by which an angle turns back before it pushes the other flank.
pub(super) const REVERSAL_COUNTS: f64 = 2.0;

/// Direction of an angle's motion, and the farthest that it has come in it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Flank {
    sign: f64,
    farthest: f64,
}

impl Flank {
    /// Takes the next angle; it pushes the other flank once it has turned back by more than `reversal`. Returns 1 or −1, 0 before the angle
    /// has moved.
    pub(super) fn follow(&mut self, angle: f64, reversal: f64) -> f64 {
        if self.sign * (angle - self.farthest) >= 0.0 && self.sign != 0.0 {
            self.farthest = angle;
        } else if (angle - self.farthest).abs() > reversal {
            self.sign = (angle - self.farthest).signum();
            self.farthest = angle;
        }
        self.sign
    }

    /// Whether the last angle is the farthest in its direction, within `reversal`.
    pub(super) fn pushes(&self, angle: f64, reversal: f64) -> bool {
        self.sign != 0.0 && self.sign * (angle - self.farthest) >= -reversal
    }
}

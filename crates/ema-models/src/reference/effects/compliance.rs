//! Compliant transmission: motor and load as two masses with a spring, a damper and the play between them.

/// Two masses, referred to the motor shaft; a rigid shaft where `resonance` is 0.
///
/// `f_r = √(K (1/J_m + 1/J_l)) / 2π` with both ends free; the damper is `D = 2 ζ 2π f_r J_m J_l / (J_m + J_l)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compliance {
    /// Resonance f_r with the motor free, Hz; 0 for a rigid shaft.
    pub resonance: f64,
    /// Damping ratio ζ of this resonance.
    pub damping_ratio: f64,
    /// Share J_l / J of the inertia on the load side.
    pub load_inertia: f64,
    /// Share of the dry friction on the load side.
    pub load_friction: f64,
}

impl Default for Compliance {
    /// Rigid. When a resonance is set: ζ = 0.03, J_l = 0.23 J, 30 % of the dry friction on the load side.
    fn default() -> Self {
        Self {
            resonance: 0.0,
            damping_ratio: 0.03,
            load_inertia: 0.23,
            load_friction: 0.3,
        }
    }
}

/// Constants of the two masses of one unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TwoMasses {
    /// Motor inertia J_m, kg·m².
    pub(crate) motor_inertia: f64,
    /// Load inertia J_l at the motor shaft, kg·m².
    pub(crate) load_inertia: f64,
    stiffness: f64,
    damping: f64,
    half_play: f64,
}

impl TwoMasses {
    /// The masses of an inertia J, kg·m², and half the play at the motor shaft, rad; `None` for a rigid shaft.
    pub(crate) fn new(compliance: &Compliance, inertia: f64, half_play: f64) -> Option<Self> {
        if compliance.resonance <= 0.0 {
            return None;
        }
        let load_inertia = compliance.load_inertia * inertia;
        let motor_inertia = inertia - load_inertia;
        let reduced = motor_inertia * load_inertia / inertia;
        let omega = core::f64::consts::TAU * compliance.resonance;
        Some(Self {
            motor_inertia,
            load_inertia,
            stiffness: omega * omega * reduced,
            damping: 2.0 * compliance.damping_ratio * omega * reduced,
            half_play,
        })
    }

    /// Torque from the motor to the load at a twist θ_m − θ_l, rad, and its rate, rad/s, in Nm.
    ///
    /// Inside the play there is none. The flanks of a play can only push, so damping never pulls them together.
    pub(crate) fn transmitted(&self, twist: f64, rate: f64) -> f64 {
        let strain = if twist > self.half_play {
            twist - self.half_play
        } else if twist < -self.half_play {
            twist + self.half_play
        } else {
            return 0.0;
        };
        let torque = self.stiffness * strain + self.damping * rate;
        if self.half_play > 0.0 && torque * strain < 0.0 {
            return 0.0;
        }
        torque
    }
}

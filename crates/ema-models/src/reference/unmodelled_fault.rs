//! Faults of a simulated actuator that the fault vector does not contain, for tests of the report `unmodelled`.
//!
//! A weak magnet is not among them: it is a unit with a smaller k.

/// A fault that the fault vector does not contain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum UnmodelledFault {
    /// A positive error of the resolver of up to this angle, rad, over a twentieth of each motor revolution. It affects
    /// commutation and counts, but not the speed loop.
    ResolverTooth(f64),
    /// A brake with this Coulomb torque at the motor, Nm; a large torque locks the output.
    Brake(f64),
}

/// Width of the resolver's error, as a share of a revolution.
const TOOTH: f64 = 0.05;

impl UnmodelledFault {
    /// Angle of the resolver at a motor angle, rad.
    #[must_use]
    pub fn resolver_angle(unmodelled_fault: Option<Self>, theta_m: f64) -> f64 {
        let Some(Self::ResolverTooth(height)) = unmodelled_fault else {
            return theta_m;
        };
        let revolutions = theta_m / core::f64::consts::TAU;
        let x = (revolutions - libm::floor(revolutions)) / TOOTH;
        // One period of a raised cosine.
        let hump = if x < 1.0 {
            0.5 * (1.0 - libm::cos(core::f64::consts::TAU * x))
        } else {
            0.0
        };
        theta_m + height * hump
    }

    /// Coulomb torque of the brake, Nm; 0 without a brake.
    #[must_use]
    pub fn brake_torque(unmodelled_fault: Option<Self>) -> f64 {
        match unmodelled_fault {
            Some(Self::Brake(torque)) => torque,
            Some(Self::ResolverTooth(_)) | None => 0.0,
        }
    }
}

//! Faults that the fault vector does not have, for tests of what is said then. (A weak magnet needs none: it is a unit with
//! a smaller k.)

/// What else is wrong with a simulated actuator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Alien {
    /// The resolver reads too much by up to so much, rad, over a twentieth of each of the motor's turns. Commutation and
    /// counts have the error, the speed loop does not.
    ResolverTooth(f64),
    /// A brake that drags at the motor with so much Coulomb torque, Nm; enough of it locks the output.
    Brake(f64),
}

/// Width of the tooth, as a share of a turn.
const TOOTH: f64 = 0.05;

impl Alien {
    /// What the resolver shows at a motor angle, rad.
    #[must_use]
    pub fn resolver(alien: Option<Self>, theta_m: f64) -> f64 {
        let Some(Self::ResolverTooth(height)) = alien else {
            return theta_m;
        };
        let turns = theta_m / core::f64::consts::TAU;
        let place = (turns - libm::floor(turns)) / TOOTH;
        // One hump of a raised cosine.
        let hump = if place < 1.0 {
            0.5 * (1.0 - libm::cos(core::f64::consts::TAU * place))
        } else {
            0.0
        };
        theta_m + height * hump
    }

    /// Additional dry friction, Nm.
    #[must_use]
    pub fn drag(alien: Option<Self>) -> f64 {
        match alien {
            Some(Self::Brake(torque)) => torque,
            Some(Self::ResolverTooth(_)) | None => 0.0,
        }
    }
}

//! Actuation profiles: what is commanded during one actuation.

/// What is commanded from the start of an actuation: a position relative to the one before it, or a speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Profile {
    /// 0.25 rad at once.
    Step,
    /// 0.6 rad/s.
    Ramp,
    /// 0.05 rad · sin 2π(0.5 τ + 7.5 τ²).
    Chirp,
    /// 0.25 rad and 0.01 rad · sin 2π(0.5 τ + 7.5 τ²): the default.
    #[default]
    Mixed,
    /// Speed mode: 100 rad/s and 20 rad/s · sin 2π(0.5 τ + 7.5 τ²) at the motor shaft.
    Speed,
    /// What a flight asks for: six moves drawn from the number, each of 5 to 200 mrad either way, at 0.1 to 3 rad/s; the
    /// first begins at once, the others within 0.4 s.
    Service(u64),
}

/// Moves of a service command.
const MOVES: u32 = 6;

impl Profile {
    /// Names of the profiles that the command line knows, as it spells them.
    pub const NAMES: [(&'static str, Self); 4] = [
        ("step", Self::Step),
        ("ramp", Self::Ramp),
        ("chirp", Self::Chirp),
        ("mixed", Self::Mixed),
    ];

    /// Commanded output angle `tau` seconds after the start, rad relative to before; 0 while `tau` is negative, and in speed
    /// mode.
    #[must_use]
    pub fn angle(self, tau: f64) -> f64 {
        if tau < 0.0 {
            return 0.0;
        }
        match self {
            Self::Step => 0.25,
            Self::Ramp => 0.6 * tau,
            Self::Chirp => 0.05 * sweep(tau),
            Self::Mixed => 0.25 + 0.01 * sweep(tau),
            Self::Speed => 0.0,
            Self::Service(seed) => service(seed, tau),
        }
    }

    /// Commanded motor speed `tau` seconds after the start, rad/s; `None` in position mode.
    #[must_use]
    pub fn speed(self, tau: f64) -> Option<f64> {
        (self == Self::Speed).then(|| if tau < 0.0 { 0.0 } else { 100.0 + 20.0 * sweep(tau) })
    }
}

fn sweep(tau: f64) -> f64 {
    libm::sin(core::f64::consts::TAU * (0.5 * tau + 7.5 * tau * tau))
}

/// Sum of drawn moves, each a ramp from its beginning to its end.
fn service(seed: u64, tau: f64) -> f64 {
    let mut state = seed;
    let mut angle = 0.0;
    for n in 0..MOVES {
        let begin = if n == 0 { 0.0 } else { 0.4 * uniform(&mut state) };
        let size = between(5e-3, 0.2, uniform(&mut state));
        let rate = between(0.1, 3.0, uniform(&mut state));
        let sign = if uniform(&mut state) < 0.5 { -1.0 } else { 1.0 };
        angle += sign * (rate * (tau - begin)).clamp(0.0, size);
    }
    angle
}

/// The number at a share of the way between two others, in equal ratios.
fn between(low: f64, high: f64, share: f64) -> f64 {
    low * libm::pow(high / low, share)
}

/// Next number in [0, 1) of SplitMix64.
fn uniform(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_service_command_triggers_and_keeps_its_limits() {
        for seed in 0..200 {
            let service = Profile::Service(seed);
            let (mut last, mut reached) = (0.0, 0.0_f64);
            for n in 0..500 {
                let angle = service.angle(f64::from(n) * 1e-3);
                assert!((angle - last).abs() <= 6.0 * 3.0 * 1e-3 + 1e-12, "seed {seed}, {n} ms");
                last = angle;
                reached = reached.max(angle.abs());
            }
            assert!((1e-3..=1.2).contains(&reached), "seed {seed}: {reached}");
        }
    }
}

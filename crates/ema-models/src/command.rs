//! Actuation profiles: the command as a function of the time since the start of an actuation.

/// Profile of the command: an output angle relative to that before the actuation, or a motor speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Profile {
    /// A step of 0.25 rad.
    Step,
    /// A ramp of 0.6 rad/s.
    Ramp,
    /// A chirp, 0.05 rad · sin 2π(0.5 τ + 7.5 τ²).
    Chirp,
    /// A step with a chirp, 0.25 rad + 0.01 rad · sin 2π(0.5 τ + 7.5 τ²); the default.
    #[default]
    Mixed,
    /// Speed mode: 100 rad/s + 20 rad/s · sin 2π(0.5 τ + 7.5 τ²) at the motor shaft; [`Profile::Mixed`] in speed mode.
    Speed,
    /// Speed mode: a step to 100 rad/s, which is held until the next.
    SpeedStep,
    /// Speed mode: a ramp of 240 rad/s², which reaches 120 rad/s in 0.5 s.
    SpeedRamp,
    /// Speed mode: a chirp, 20 rad/s · sin 2π(0.5 τ + 7.5 τ²).
    SpeedChirp,
    /// A command as in flight: six moves drawn from this seed, each of 5 to 200 mrad in either direction, at 0.1 to 3 rad/s.
    /// The first begins at the start, the others within 0.4 s.
    Service(u64),
}

/// Number of moves of a service command.
const MOVES: u32 = 6;

impl Profile {
    /// Profiles of the command line, by name; [`Profile::in_speed_mode`] gives those of speed mode.
    pub const NAMES: [(&'static str, Self); 4] = [
        ("step", Self::Step),
        ("ramp", Self::Ramp),
        ("chirp", Self::Chirp),
        ("mixed", Self::Mixed),
    ];

    /// Commanded output angle at the time `tau` after the start, s, relative to the angle before, rad; 0 for negative `tau` and
    /// in speed mode.
    #[must_use]
    pub fn commanded_angle(self, tau: f64) -> f64 {
        if tau < 0.0 {
            return 0.0;
        }
        match self {
            Self::Step => 0.25,
            Self::Ramp => 0.6 * tau,
            Self::Chirp => 0.05 * sweep(tau),
            Self::Mixed => 0.25 + 0.01 * sweep(tau),
            Self::Speed | Self::SpeedStep | Self::SpeedRamp | Self::SpeedChirp => 0.0,
            Self::Service(seed) => service(seed, tau),
        }
    }

    /// Commanded motor speed at the time `tau` after the start, s, in rad/s; 0 for negative `tau`, `None` in position mode.
    #[must_use]
    pub fn commanded_speed(self, tau: f64) -> Option<f64> {
        let speed: fn(f64) -> f64 = match self {
            Self::Speed => |tau| 100.0 + 20.0 * sweep(tau),
            Self::SpeedStep => |_| 100.0,
            Self::SpeedRamp => |tau| 240.0 * tau,
            Self::SpeedChirp => |tau| 20.0 * sweep(tau),
            Self::Step | Self::Ramp | Self::Chirp | Self::Mixed | Self::Service(_) => return None,
        };
        Some(if tau < 0.0 { 0.0 } else { speed(tau) })
    }

    /// The profile of this shape in speed mode; `None` for a service command, which is one of angles.
    #[must_use]
    pub fn in_speed_mode(self) -> Option<Self> {
        match self {
            Self::Step => Some(Self::SpeedStep),
            Self::Ramp => Some(Self::SpeedRamp),
            Self::Chirp => Some(Self::SpeedChirp),
            Self::Mixed => Some(Self::Speed),
            Self::Speed | Self::SpeedStep | Self::SpeedRamp | Self::SpeedChirp => Some(self),
            Self::Service(_) => None,
        }
    }
}

/// Chirp of unit amplitude, sin 2π(0.5 τ + 7.5 τ²).
fn sweep(tau: f64) -> f64 {
    libm::sin(core::f64::consts::TAU * (0.5 * tau + 7.5 * tau * tau))
}

/// Angle of a service command: the sum of its moves, each a ramp, rad.
fn service(seed: u64, tau: f64) -> f64 {
    let mut state = seed;
    let mut angle = 0.0;
    for n in 0..MOVES {
        let begin = if n == 0 { 0.0 } else { 0.4 * uniform(&mut state) };
        let size = geometric_mean(5e-3, 0.2, uniform(&mut state));
        let rate = geometric_mean(0.1, 3.0, uniform(&mut state));
        let sign = if uniform(&mut state) < 0.5 { -1.0 } else { 1.0 };
        angle += sign * (rate * (tau - begin)).clamp(0.0, size);
    }
    angle
}

/// Weighted geometric mean `low^(1 − share) high^share`.
fn geometric_mean(low: f64, high: f64, share: f64) -> f64 {
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
    fn each_named_profile_commands_an_angle_and_in_speed_mode_a_speed() {
        for (name, profile) in Profile::NAMES {
            let speed = profile.in_speed_mode().unwrap();
            assert_eq!(speed.in_speed_mode(), Some(speed), "{name}");
            assert_eq!(profile.commanded_speed(0.2), None, "{name}");
            assert!(profile.commanded_angle(0.2).abs() > 0.0 && speed.commanded_angle(0.2) < f64::MIN_POSITIVE);
            let commanded = |tau| speed.commanded_speed(tau).unwrap();
            assert!(commanded(-1e-9) < f64::MIN_POSITIVE, "{name}");
            // A window begins where the commanded speed has changed by 1 rad/s.
            let most = (0..500).map(|ms| commanded(f64::from(ms) * 1e-3)).fold(0.0, f64::max);
            assert!((1.0..=120.0).contains(&most), "{name}: {most}");
        }
        assert_eq!(Profile::Service(1).in_speed_mode(), None);
    }

    #[test]
    fn a_service_command_moves_within_its_limits_of_angle_and_rate() {
        for seed in 0..200 {
            let service = Profile::Service(seed);
            let (mut last, mut reached) = (0.0, 0.0_f64);
            for n in 0..500 {
                let angle = service.commanded_angle(f64::from(n) * 1e-3);
                assert!((angle - last).abs() <= 6.0 * 3.0 * 1e-3 + 1e-12, "seed {seed}, {n} ms");
                last = angle;
                reached = reached.max(angle.abs());
            }
            assert!((1e-3..=1.2).contains(&reached), "seed {seed}: {reached}");
        }
    }
}

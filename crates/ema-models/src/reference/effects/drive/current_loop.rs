//! Current control in the rotor frame: once per PWM period, its voltages applied one period later.

use core::f64::consts::TAU;

use super::VectorDrive;
use super::pwm::{Leg, Pulse};
use crate::frames::{abc_from_alpha_beta, alpha_beta_from_dq, dq_from_abc};
use crate::params::MotorParams;
use crate::real::Real;

/// What the drive measures and is commanded, and the currents of its legs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DriveInput {
    /// Phase currents as measured, A.
    pub(crate) measured: [f64; 3],
    /// Phase currents, A; their signs decide on edges within the dead time.
    pub(crate) i: [f64; 3],
    /// Sine and cosine of the electrical angle as measured.
    pub(crate) sin_cos: (f64, f64),
    /// Motor speed, rad/s.
    pub(crate) omega_m: f64,
    /// Quadrature current reference, A.
    pub(crate) i_ref: f64,
    /// DC link voltage, V.
    pub(crate) v_dc: f64,
}

/// Constants of the current control, set for the type's motor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VectorControl {
    drive: VectorDrive,
    period: f64,
    k_p: f64,
    k_i: f64,
    motor: MotorParams,
}

/// State of the current control and of the modulator.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VectorState {
    /// Time since the beginning of the PWM period, s.
    elapsed: f64,
    /// Time in the period until which no leg changes its level, s.
    quiet_until: f64,
    /// Integral parts of the d and q voltage, V.
    integral: [f64; 2],
    /// Direct current reference, A; negative while the field is weakened.
    i_d_ref: f64,
    running: [Pulse; 3],
    next: [Pulse; 3],
    legs: [Leg; 3],
}

impl Default for VectorState {
    /// At the end of a period without voltage: a new one begins at once.
    fn default() -> Self {
        Self {
            elapsed: f64::INFINITY,
            quiet_until: 0.0,
            integral: [0.0; 2],
            i_d_ref: 0.0,
            running: [Pulse::default(); 3],
            next: [Pulse::default(); 3],
            legs: [Leg::default(); 3],
        }
    }
}

/// Interval that counts as none, s: far below an edge's effect, far above rounding.
const INSTANT: f64 = 1e-12;

/// Share of the linear voltage range V_dc/√3 above which the field is weakened.
const WEAKENING_FROM: f64 = 0.95;

/// Bandwidth of the field weakening relative to that of the current control.
const WEAKENING_BANDWIDTH: f64 = 0.1;

impl VectorControl {
    pub(crate) fn new(drive: &VectorDrive, motor: &MotorParams) -> Self {
        let omega_c = TAU * drive.bandwidth;
        Self {
            drive: *drive,
            period: 1.0 / drive.pwm_frequency,
            k_p: omega_c * motor.l_s,
            k_i: omega_c * motor.r_s,
            motor: *motor,
        }
    }

    /// Whether a PWM period begins within the next `dt`: only then the drive looks at what it measures.
    pub(crate) fn samples_within(&self, state: &VectorState, dt: f64) -> bool {
        state.elapsed + dt > self.period - INSTANT
    }

    /// Mean phase voltages over the next `dt`, relative to the midpoint of the DC link, V.
    pub(crate) fn step(&self, state: &mut VectorState, input: &DriveInput, dt: f64) -> [f64; 3] {
        if state.elapsed + dt <= state.quiet_until {
            state.elapsed += dt;
            let half = 0.5 * input.v_dc;
            return state.legs.map(|leg| if leg.is_high() { half } else { -half });
        }
        let mut high = [0.0; 3];
        let mut left = dt;
        while left > INSTANT {
            if state.elapsed > self.period - INSTANT {
                self.begin_period(state, input);
            }
            let from = state.elapsed;
            let to = from + left.min(self.period - from);
            for j in 0..3 {
                high[j] += state.legs[j].advance(state.running[j], from, to, self.drive.dead_time, input.i[j]);
            }
            state.elapsed = to;
            left -= to - from;
        }
        let changes = (0..3).map(|j| state.legs[j].next_change(state.running[j], state.elapsed));
        state.quiet_until = changes.fold(self.period - INSTANT, f64::min);
        high.map(|time| input.v_dc * (time / dt - 0.5))
    }

    /// Begins a PWM period: last period's voltages are applied, the next ones computed from the currents of this instant.
    ///
    /// `v = K_p e + ∫ + decoupling`, limited to the hexagon along its direction; the integrals follow the limited voltage.
    /// The voltage is turned by the angle until the middle of its period, 1.5 T_p ω_e.
    fn begin_period(&self, state: &mut VectorState, input: &DriveInput) {
        state.elapsed = if state.elapsed.is_finite() {
            (state.elapsed - self.period).max(0.0)
        } else {
            0.0
        };
        state.running = state.next;
        for leg in &mut state.legs {
            leg.begin_period(self.period);
        }

        let omega_e = self.motor.pole_pairs * input.omega_m;
        let [i_d, i_q] = dq_from_abc(input.measured, input.sin_cos);
        let i_q_max = libm::sqrt((self.motor.i_max * self.motor.i_max - state.i_d_ref * state.i_d_ref).max(0.0));
        let i_q_ref = if state.i_d_ref < 0.0 {
            input.i_ref.clamp_abs(i_q_max)
        } else {
            input.i_ref
        };
        let errors = [state.i_d_ref - i_d, i_q_ref - i_q];
        let feed_forward = [
            -omega_e * self.motor.l_s * i_q,
            omega_e * self.motor.l_s * i_d + self.motor.k * input.omega_m,
        ];
        let wanted: [f64; 2] = core::array::from_fn(|axis| {
            self.k_p * errors[axis] + state.integral[axis] + self.drive.decoupling * feed_forward[axis]
        });

        let at_middle = turned(input.sin_cos, 1.5 * self.period * omega_e);
        let phases = abc_from_alpha_beta(alpha_beta_from_dq(wanted, at_middle));
        let share = (input.v_dc / span(phases)).min(1.0);
        for axis in 0..2 {
            let cut = (share - 1.0) * wanted[axis] / self.k_p;
            state.integral[axis] += self.k_i * self.period * (errors[axis] + cut);
        }
        state.i_d_ref = self.weakened_field(state.i_d_ref, libm::hypot(wanted[0], wanted[1]), omega_e, input.v_dc);

        let currents = abc_from_alpha_beta(alpha_beta_from_dq([i_d, i_q], at_middle));
        let dead_voltage = self.drive.dead_time_compensation * input.v_dc * self.drive.dead_time / self.period;
        let voltages: [f64; 3] =
            core::array::from_fn(|j| share * phases[j] + if currents[j] < 0.0 { -dead_voltage } else { dead_voltage });
        let [min, max] = extremes(voltages);
        state.next = voltages.map(|v| Pulse::centred(0.5 + (v - 0.5 * (min + max)) / input.v_dc, self.period));
    }

    /// Direct current reference of the next period: the integral of the voltage that is left, A.
    fn weakened_field(&self, i_d_ref: f64, voltage: f64, omega_e: f64, v_dc: f64) -> f64 {
        if self.drive.field_weakening <= 0.0 {
            return 0.0;
        }
        let left = WEAKENING_FROM * v_dc / libm::sqrt(3.0) - voltage;
        let ohms = libm::fabs(omega_e * self.motor.l_s).max(self.motor.r_s);
        let rate = WEAKENING_BANDWIDTH * TAU * self.drive.bandwidth * left / ohms;
        (i_d_ref + self.period * rate).clamp(-self.drive.field_weakening, 0.0)
    }
}

/// Sine and cosine of an angle plus `turn`, rad.
fn turned((sin, cos): (f64, f64), turn: f64) -> (f64, f64) {
    let (s, c) = turn.sin_cos_poly();
    (sin * c + cos * s, cos * c - sin * s)
}

fn extremes([a, b, c]: [f64; 3]) -> [f64; 2] {
    [a.min(b).min(c), a.max(b).max(c)]
}

/// Largest difference of two phase voltages, V; never zero, so that a voltage can be divided by it.
fn span(voltages: [f64; 3]) -> f64 {
    let [min, max] = extremes(voltages);
    (max - min).max(1e-9)
}

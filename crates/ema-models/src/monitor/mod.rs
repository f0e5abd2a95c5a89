//! Low-fidelity monitor: the actuator averaged over the switching of its inverter, fast enough for thousands of windows per
//! second.
//!
//! Input are parameters, calibration, unknowns and the samples of a window; output are the signals of each sample. Controller,
//! friction, backlash and windings are those of the reference; current loop and integration step are the monitor's own. The
//! step exists once, generic over [`Real`]; it neither allocates nor needs `std`.

mod build;
mod one_axis;
mod ripple;
mod settings;
#[cfg(feature = "study")]
pub mod study;
mod three_phase;

pub use ripple::{RIPPLE_KNOTS, RIPPLE_VOLTAGES, Ripple};
pub use settings::{Calibration, Conditions, Feedback, Form};

use crate::backlash::follow_through_play;
use crate::control::{Ace, AceState, Encoder, Setpoint};
use crate::frames::{abc_from_alpha_beta, alpha_beta_from_dq, dq_from_abc, per_phase, phase_shapes};
use crate::friction::DryFriction;
use crate::params::ActuatorParams;
use crate::real::Real;
use crate::samples::{ComparedSample, InitialState};
use crate::winding::{DerivedShape, Winding, derived_shape};
use ripple::RippleCurve;

/// Constants of one monitor, or of several with different unknowns, one per lane.
#[derive(Clone, Copy, Debug)]
pub struct Monitor<R> {
    form: Form,
    feedback: Feedback,
    ace: Ace<R>,
    encoder: Encoder<R>,
    friction: DryFriction<R>,
    winding: Winding<R>,
    half_play: R,
    ripple: RippleCurve<R>,
    derived: Derived<R>,
    steps_per_control: u32,
    controls_per_sample: u32,
    /// Nominal torque per ampere in the controller, Nm/A.
    torque_gain: R,
    /// Initial integral of the speed loop minus its value from the measured currents, Nm.
    integral: R,
}

/// Constants of the step, computed once.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Derived<R> {
    dt: R,
    half_dt: R,
    per_dt: R,
    dt_over_j: R,
    viscous: R,
    per_gear: R,
    pole_pairs: R,
    v_dc: R,
    half_v_dc: R,
    per_half_v_dc: R,
    /// Square of the inverter's largest voltage, averaged over all angles, V².
    v_max_squared: R,
    /// Mean of L_j/dt over the phases, Ω.
    mean_ohms: R,
    phase_r: R,
    phase_l: R,
    /// Calibrated k as back-EMF and as torque coefficient, and half of each.
    back_emf: R,
    half_back_emf: R,
    torque: R,
    half_torque: R,
    /// Share of a current's deviation from its reference that is left after a control period: `e^(−T/τ)`, 0 for comparators.
    current_left: R,
    /// Torque-producing current per quadrature current, averaged over all angles: half the sum of the turns ratios.
    torque_current_per_amp: R,
    /// R_j and P L_j.
    r: [R; 3],
    reactance: [R; 3],
    /// L_j/dt + R_j/2, L_j/dt − R_j/2, and the inverse of the former.
    ohms: [R; 3],
    ohms_before: [R; 3],
    siemens: [R; 3],
    /// 1 / Σ siemens, over all phases and over the two other phases.
    star_ohms: R,
    star_ohms_without: [R; 3],
}

/// State of the monitor. Angles are relative to the window's [`Origin`](crate::Origin).
#[derive(Clone, Copy, Debug)]
pub struct MonitorState<R> {
    /// Phase currents, A (three-phase form).
    i: [R; 3],
    /// Quadrature current, A (one-axis forms).
    i_q: R,
    theta_m: R,
    omega_m: R,
    theta_out: R,
    ace: AceState<R>,
    /// References of the direct and quadrature current, including the mean effect of the hysteresis band, A.
    i_ref: [R; 2],
    /// Change of the speed in the last step, rad/s.
    speed_change: R,
    /// Torque that the shaft lacked to break away at the end of the last step, Nm ([`DryFriction::long_step`]).
    breakaway_deficit: R,
    /// Motor angle at the end of the last step, as predicted for the motor model, rad; sine and cosine of its electrical angle.
    predicted_theta_m: R,
    sin_cos: (R, R),
    emf_shapes: [R; 3],
    /// Torque-producing current: Σ over the phases of back-EMF shape times current, A; corrected for the step of the reference
    /// at the start of a control period.
    torque_current: R,
}

/// Signals of the monitor at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output<R> {
    /// Direct current, A.
    pub i_d: R,
    /// Quadrature current, A.
    pub i_q: R,
    /// Motor angle relative to the origin, rad.
    pub theta_m: R,
    /// Motor speed, rad/s.
    pub omega_m: R,
    /// Output angle relative to the origin, rad.
    pub theta_out: R,
}

/// Integration steps of the monitor per control period, at least.
pub const STEPS_PER_CONTROL: u32 = 2;

/// Largest electrical turn in a step at the largest speed reference, rad: the series of the rotation is 2e-5 off there.
pub const TURN_MAX: f64 = 0.5;

/// Integration steps of an actuator's monitor per control period: [`STEPS_PER_CONTROL`], or as many as keep the motor within
/// [`TURN_MAX`] in each.
#[must_use]
pub fn steps_per_control(params: &ActuatorParams) -> u32 {
    let steps = libm::ceil(params.turn_per_control() / TURN_MAX - 1e-9) as u32;
    steps.max(STEPS_PER_CONTROL)
}

impl<R: Real> Monitor<R> {
    /// The monitor with this source of its angles.
    #[must_use]
    pub fn with_feedback(self, feedback: Feedback) -> Self {
        Self { feedback, ..self }
    }

    /// State at the start of a window.
    #[must_use]
    #[inline(always)]
    pub fn start(&self, initial: &InitialState, first: &ComparedSample) -> MonitorState<R> {
        let theta_m = R::splat(initial.theta_m);
        let sin_cos = self.electrical_angle(initial, theta_m).sin_cos_poly();
        // The output angle lies within both the backlash and the measured encoder count.
        let centre = R::splat(initial.origin.play_centre) + theta_m * self.derived.per_gear;
        let count = self.encoder.lower_edge(first.theta_out);
        let lower = (centre - self.half_play).max(count);
        let upper = (centre + self.half_play).min(count + self.encoder.lsb());
        let [d, q] = [R::splat(initial.i_dq[0]), R::splat(initial.i_dq[1])];
        let i = abc_from_alpha_beta(alpha_beta_from_dq([d, q], sin_cos));
        let emf_shapes = self.winding.emf_shapes(sin_cos);
        MonitorState {
            i,
            i_q: q,
            theta_m,
            omega_m: R::splat(initial.omega_m),
            theta_out: R::splat(0.5) * (lower + upper),
            ace: self.ace.steady_state(
                q * self.torque_gain + self.integral,
                first.setpoint.map(R::splat),
                count,
                R::splat(initial.omega_m),
            ),
            i_ref: [d, q],
            speed_change: R::zero(),
            breakaway_deficit: R::zero(),
            predicted_theta_m: theta_m,
            sin_cos,
            emf_shapes,
            torque_current: torque_producing_current(emf_shapes, i),
        }
    }

    /// Electrical angle, rad.
    #[inline(always)]
    fn electrical_angle(&self, initial: &InitialState, theta_m: R) -> R {
        R::splat(initial.origin.theta_e) + self.derived.pole_pairs * theta_m
    }

    /// Signals at the present instant.
    #[inline(always)]
    pub fn output(&self, state: &MonitorState<R>) -> Output<R> {
        let [i_d, i_q] = match self.form {
            Form::ThreePhase => dq_from_abc(state.i, state.sin_cos),
            Form::Paper(_) | Form::OneAxis => [R::zero(), state.i_q],
        };
        Output {
            i_d,
            i_q,
            theta_m: state.theta_m,
            omega_m: state.omega_m,
            theta_out: state.theta_out,
        }
    }

    /// Runs one sample period, from the instant of `now` to that of `next`, under the setpoint of `now`.
    ///
    /// With [`Feedback::Simulated`] the samples give only the setpoint.
    #[inline(always)]
    pub fn run_sample_period(
        &self,
        state: &mut MonitorState<R>,
        initial: &InitialState,
        now: &ComparedSample,
        next: &ComparedSample,
    ) {
        self.run_sample_period_under(state, initial, [now, next], &self.friction, |torque| torque);
    }

    /// Friction and load of the shaft.
    pub(crate) fn friction(&self) -> &DryFriction<R> {
        &self.friction
    }

    /// [`Monitor::run_sample_period`] from the first to the second sample, with this friction, and with another torque on the shaft:
    /// `on_shaft` gives it from that of the motor, Nm.
    #[inline(always)]
    pub(crate) fn run_sample_period_under(
        &self,
        state: &mut MonitorState<R>,
        initial: &InitialState,
        [now, next]: [&ComparedSample; 2],
        friction: &DryFriction<R>,
        on_shaft: impl Fn(R) -> R + Copy,
    ) {
        let setpoint = now.setpoint.map(R::splat);
        // The compiler keeps a local copy in registers.
        let mut own = *state;
        self.refresh_sin_cos(&mut own, initial);
        for control in 0..self.controls_per_sample {
            let counted = match self.feedback {
                Feedback::Simulated => self.encoder.counted_angle(own.theta_out),
                Feedback::Measured => {
                    let read = output_angle_between(now, next, control, self.controls_per_sample);
                    self.encoder.counted_angle(R::splat(read))
                }
            };
            self.control_period(&mut own, initial, (setpoint, counted), friction, on_shaft);
        }
        if self.feedback == Feedback::Measured {
            self.move_output(&mut own, initial, R::splat(next.theta_m));
        }
        *state = own;
    }

    /// [`Monitor::run_sample_period`] with [`Feedback::Measured`] and precomputed inputs, which several monitors can share: the
    /// setpoint, the counted output angle of each control period ([`output_angle_between`]), rad, and the motor angle at the
    /// end, rad.
    #[inline(always)]
    pub fn run_sample_period_with(
        &self,
        state: &mut MonitorState<R>,
        initial: &InitialState,
        setpoint: Setpoint<R>,
        counted: &[R],
        theta_m: R,
    ) {
        let mut own = *state;
        self.refresh_sin_cos(&mut own, initial);
        for &counted in counted {
            self.control_period(&mut own, initial, (setpoint, counted), &self.friction, |torque| torque);
        }
        self.move_output(&mut own, initial, theta_m);
        *state = own;
    }

    /// Recomputes sine and cosine of the electrical angle, so that the errors of the rotations in each step do not accumulate.
    #[inline(always)]
    fn refresh_sin_cos(&self, state: &mut MonitorState<R>, initial: &InitialState) {
        state.sin_cos = self.electrical_angle(initial, state.predicted_theta_m).sin_cos_poly();
    }

    /// The controller's step at the start of its period, and the integration steps within the period.
    #[inline(always)]
    fn control_period(
        &self,
        state: &mut MonitorState<R>,
        initial: &InitialState,
        (setpoint, counted): (Setpoint<R>, R),
        friction: &DryFriction<R>,
        on_shaft: impl Fn(R) -> R + Copy,
    ) {
        let i_ref = self.ace.step(&mut state.ace, setpoint, counted, state.omega_m);
        state.i_ref = match self.form {
            Form::ThreePhase => {
                let v = self.steady_voltage(state, i_ref);
                let held = self.mean_currents(i_ref, v);
                // No `map` over an array: the compiler does not inline registers into its closure, which doubles the time of all.
                let left = |held: R, before: R| (held - before) * self.derived.current_left;
                let mean = [
                    held[0] - left(held[0], state.i_ref[0]),
                    held[1] - left(held[1], state.i_ref[1]),
                ];
                #[cfg(feature = "study")]
                let mean = study::with_table(mean, v, self.derived.per_half_v_dc, state.sin_cos);
                state.torque_current =
                    state.torque_current + self.reference_step_correction(mean[1] - state.i_ref[1], v);
                mean
            }
            Form::Paper(_) | Form::OneAxis => [R::zero(), i_ref],
        };
        for _ in 0..self.steps_per_control {
            self.step(state, initial, friction, on_shaft);
        }
    }

    /// Moves the output with the motor through the backlash.
    #[inline(always)]
    fn move_output(&self, state: &mut MonitorState<R>, initial: &InitialState, theta_m: R) {
        let centre = R::splat(initial.origin.play_centre) + theta_m * self.derived.per_gear;
        state.theta_out = follow_through_play(state.theta_out, centre, self.half_play);
    }

    /// Direct and quadrature voltage for a constant current reference at the present speed, V.
    #[inline(always)]
    fn steady_voltage(&self, state: &MonitorState<R>, i_ref: R) -> [R; 2] {
        let m = &self.derived;
        let (sin, cos) = state.sin_cos;
        let shapes = phase_shapes((sin, cos));
        // cos(theta_e − 2πj/3) = −ds_j/dtheta_e.
        let slopes = abc_from_alpha_beta([cos, sin]);
        let back_emf = m.back_emf * state.omega_m;
        let v = per_phase!(|j| {
            let reactance = m.reactance[j] * state.omega_m;
            i_ref * (m.r[j] * shapes[j] - reactance * slopes[j]) + back_emf * state.emf_shapes[j]
        });
        dq_from_abc(v, state.sin_cos)
    }

    /// Mean direct and quadrature current that the comparators hold for a reference, A, under the steady voltage, V.
    #[inline(always)]
    fn mean_currents(&self, i_ref: R, [v_d, v_q]: [R; 2]) -> [R; 2] {
        // The offset excludes zero, which has no direction.
        let length = (v_d * v_d + v_q * v_q + R::splat(1e-12)).sqrt();
        let per_volt = self.ripple.shortfall(length * self.derived.per_half_v_dc) / length;
        [-per_volt * v_d, i_ref - per_volt * v_q]
    }

    /// Correction of the torque-producing current at the start of a step for a step of the current reference, A:
    /// `(1 − f) Σ N_j/2 Δi_q`.
    ///
    /// The inverter at its rails changes the quadrature current by Δi_q within the first share f of the step, and the current
    /// is then constant. With the corrected value, the mean of both ends of the step is its mean torque-producing current.
    /// `f = L |Δi_q| / (Δt (√(v_max² − v_d²) ∓ v_q))`, at most 1, where v is the steady voltage for the new reference: the
    /// voltage left along q drives the change, and the back-EMF supports a change against its direction. v_max is the inverter's
    /// largest voltage averaged over all angles, L the mean of the phases. Derived here.
    #[inline(always)]
    fn reference_step_correction(&self, change: R, [v_d, v_q]: [R; 2]) -> R {
        let m = &self.derived;
        let available = (m.v_max_squared - v_d * v_d).max(R::zero()).sqrt();
        // Numerator and denominator are multiplied by |Δi_q|, so that the product v_q Δi_q gives the sign.
        let driving = available * change.abs() - v_q * change;
        let share = change * change * m.mean_ohms / driving.max(R::splat(1e-6));
        (R::splat(1.0) - share.min(R::splat(1.0))) * m.torque_current_per_amp * change
    }

    /// One integration step: the currents at the predicted angle, then the motion under the mean torque of both ends.
    #[inline(always)]
    fn step(
        &self,
        state: &mut MonitorState<R>,
        initial: &InitialState,
        friction: &DryFriction<R>,
        on_shaft: impl Fn(R) -> R,
    ) {
        let m = &self.derived;
        let half = R::splat(0.5);
        let omega = state.omega_m;
        let omega_mid = omega + half * state.speed_change;
        let ahead = state.theta_m + omega_mid * m.dt;
        let sin_cos = R::rotate(state.sin_cos, m.pole_pairs * (ahead - state.predicted_theta_m));
        state.predicted_theta_m = ahead;

        let torque = match self.form {
            Form::ThreePhase => {
                let shapes = self.winding.emf_shapes(sin_cos);
                let volts = m.half_back_emf * omega_mid;
                let emf = per_phase!(|j| (state.emf_shapes[j] + shapes[j]) * volts);
                let target = abc_from_alpha_beta(alpha_beta_from_dq(state.i_ref, sin_cos));
                state.i = three_phase::step(m, state.i, target, emf);
                state.emf_shapes = shapes;
                let before = state.torque_current;
                state.torque_current = torque_producing_current(shapes, state.i);
                m.half_torque * (before + state.torque_current)
            }
            Form::OneAxis => self.one_axis(state, &derived_shape(&self.winding, state.sin_cos), omega_mid),
            Form::Paper(paper) => {
                let phi = paper.shape(&self.winding, state.sin_cos);
                let shape = DerivedShape {
                    emf: phi,
                    resistance: phi,
                    inductance: R::splat(1.0),
                    inductance_slope: R::zero(),
                };
                self.one_axis(state, &shape, omega_mid)
            }
        };
        state.sin_cos = sin_cos;

        state.omega_m = friction.long_step(
            omega,
            on_shaft(torque) - m.viscous * omega,
            m.dt_over_j,
            &mut state.breakaway_deficit,
        );
        state.speed_change = state.omega_m - omega;
        state.theta_m = state.theta_m + (omega + state.omega_m) * m.half_dt;
        if self.feedback == Feedback::Simulated {
            self.move_output(state, initial, state.theta_m);
        }
    }

    /// Advances the equivalent phase by one step and returns the mean torque of the step, Nm.
    #[inline(always)]
    fn one_axis(&self, state: &mut MonitorState<R>, shape: &DerivedShape<R>, omega: R) -> R {
        let before = state.i_q;
        state.i_q = one_axis::step(&self.derived, before, state.i_ref[1], shape, omega, state.sin_cos);
        R::splat(0.75) * self.derived.torque * shape.emf * (before + state.i_q)
    }
}

/// Torque-producing current: Σ over the phases of back-EMF shape times current, A.
#[inline(always)]
fn torque_producing_current<R: Real>([a, b, c]: [R; 3], [i_a, i_b, i_c]: [R; 3]) -> R {
    a * i_a + b * i_b + c * i_c
}

/// Estimated output angle at the start of control period `control` of `controls` from one sample to the next, rad.
///
/// Between the samples the output moves in proportion to the motor.
#[inline(always)]
#[must_use]
pub fn output_angle_between(now: &ComparedSample, next: &ComparedSample, control: u32, controls: u32) -> f64 {
    let share = share_of_motor_motion(now, next, f64::from(control) / f64::from(controls));
    now.theta_out_estimate + share * (next.theta_out_estimate - now.theta_out_estimate)
}

/// Share of the motor's motion between two samples that is completed after the share `x` of the time, by the cubic through
/// both angles and speeds; `x` itself where the motor does not move in one direction.
#[inline(always)]
fn share_of_motor_motion(now: &ComparedSample, next: &ComparedSample, x: f64) -> f64 {
    let rise = next.theta_m - now.theta_m;
    let (first, last) = (now.theta_m_change, next.theta_m_change);
    if first * rise <= 0.0 || last * rise <= 0.0 {
        return x;
    }
    x * (first + x * ((3.0 * rise - 2.0 * first - last) + x * (first + last - 2.0 * rise))) / rise
}

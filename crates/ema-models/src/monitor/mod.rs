//! Low-fidelity monitor: the actuator averaged over its switching, cheap enough to run thousands of times a second.
//!
//! Controller, friction, backlash and windings are the reference's own; the current loop and the step are not. The step
//! is written once, generic over [`Real`]. No allocation, no `std`.

mod build;
mod one_axis;
mod ripple;
mod settings;
#[cfg(feature = "study")]
pub mod study;
mod three_phase;

pub use ripple::{RIPPLE_KNOTS, RIPPLE_PLACES, Ripple};
pub use settings::{Calibration, Conditions, Feedback, Form};

use crate::backlash::follow_through_play;
use crate::control::{Ace, AceState, Encoder, Setpoint};
use crate::frames::{abc_from_alpha_beta, alpha_beta_from_dq, dq_from_abc, per_phase, phase_shapes};
use crate::friction::DryFriction;
use crate::real::Real;
use crate::samples::{ComparedSample, InitialState};
use crate::winding::{DerivedShape, Winding, derived_shape};
use ripple::RippleCurve;

/// One monitor, or one lane each of several that differ in their fault vectors.
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
    /// Nominal torque per ampere, as the controller has it, Nm/A.
    torque_gain: R,
    /// Start of the speed loop's integral beyond what the currents say, Nm.
    integral: R,
}

/// Constants that the step needs ready-made.
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
    /// Square of the mean voltage that the inverter reaches, V².
    v_max_squared: R,
    /// Mean of the phases' L/dt, Ω.
    mean_ohms: R,
    phase_r: R,
    phase_l: R,
    /// k with its calibration, as back-EMF and as torque coefficient, and half of each.
    back_emf: R,
    half_back_emf: R,
    torque: R,
    half_torque: R,
    /// Mean over all angles of the pull that a quadrature current makes: half the sum of the turns.
    pull_per_amp: R,
    /// R_j and P L_j.
    r: [R; 3],
    reactance: [R; 3],
    /// L_j/dt + R_j/2, L_j/dt − R_j/2, and the inverse of the former.
    ohms: [R; 3],
    ohms_before: [R; 3],
    siemens: [R; 3],
    /// 1 / Σ siemens, over all phases and over the two others.
    star_ohms: R,
    star_ohms_without: [R; 3],
}

/// State of the monitor. Angles are relative to the window's [`Origin`].
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
    /// References of the direct and quadrature current, the band's mean effect included, A.
    i_ref: [R; 2],
    /// Speed gained in the last step, rad/s.
    gained: R,
    /// Torque that the shaft lacked to break away at the end of the last step, Nm ([`DryFriction::long_step`]).
    slack: R,
    /// Motor angle of the motor model, rad: the one that the last step foresaw; and the electrical angle's sine and cosine.
    foreseen: R,
    sin_cos: (R, R),
    emf_shapes: [R; 3],
    /// Σ over the phases of back-EMF shape times current, A; at the start of a control period after its jump.
    pull: R,
}

/// What the monitor says of one instant.
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

/// Integration steps of the monitor per control period.
pub const STEPS_PER_CONTROL: u32 = 2;

impl<R: Real> Monitor<R> {
    /// The same monitor with another source of its position feedback.
    #[must_use]
    pub fn with_feedback(self, feedback: Feedback) -> Self {
        Self { feedback, ..self }
    }

    /// State at the beginning of a window.
    #[must_use]
    #[inline(always)]
    pub fn start(&self, initial: &InitialState, first: &ComparedSample) -> MonitorState<R> {
        let theta_m = R::splat(initial.theta_m);
        let sin_cos = self.angle(initial, theta_m).sin_cos_poly();
        // The output is somewhere inside both the play and the encoder count that was read.
        let centre = R::splat(initial.origin.play_centre) + theta_m * self.derived.per_gear;
        let count = self.encoder.edge(first.theta_out);
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
            ace: self.ace.steady(
                q * self.torque_gain + self.integral,
                first.setpoint.map(R::splat),
                count,
                R::splat(initial.omega_m),
            ),
            i_ref: [d, q],
            gained: R::zero(),
            slack: R::zero(),
            foreseen: theta_m,
            sin_cos,
            emf_shapes,
            pull: pull(emf_shapes, i),
        }
    }

    #[inline(always)]
    fn angle(&self, initial: &InitialState, theta_m: R) -> R {
        R::splat(initial.origin.theta_e) + self.derived.pole_pairs * theta_m
    }

    /// What the sensors would read now.
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

    /// Runs one sample period, from the instant of `now` to that of `next`, under the setpoint latched with `now`.
    ///
    /// With [`Feedback::Simulated`] nothing but the setpoint is taken from the samples.
    #[inline(always)]
    pub fn sample(
        &self,
        state: &mut MonitorState<R>,
        initial: &InitialState,
        now: &ComparedSample,
        next: &ComparedSample,
    ) {
        let setpoint = now.setpoint.map(R::splat);
        // A copy of its own stays in registers.
        let mut own = *state;
        self.turn_afresh(&mut own, initial);
        for control in 0..self.controls_per_sample {
            let counted = match self.feedback {
                Feedback::Simulated => self.encoder.counted(own.theta_out),
                Feedback::Measured => {
                    let read = output_read(now, next, control, self.controls_per_sample);
                    self.encoder.counted(R::splat(read))
                }
            };
            self.control_period(&mut own, initial, setpoint, counted);
        }
        if self.feedback == Feedback::Measured {
            self.turn_output(&mut own, initial, R::splat(next.theta_m));
        }
        *state = own;
    }

    /// [`Monitor::sample`] by the measured angles, with what it takes from the samples ready-made, for monitors that share
    /// it: the setpoint, the output angle of each control period ([`output_read`], counted), and the motor angle at the end.
    #[inline(always)]
    pub fn sample_by(
        &self,
        state: &mut MonitorState<R>,
        initial: &InitialState,
        setpoint: Setpoint<R>,
        counted: &[R],
        theta_m: R,
    ) {
        let mut own = *state;
        self.turn_afresh(&mut own, initial);
        for &counted in counted {
            self.control_period(&mut own, initial, setpoint, counted);
        }
        self.turn_output(&mut own, initial, theta_m);
        *state = own;
    }

    /// Sine and cosine are turned from step to step, and made afresh before that adds up.
    #[inline(always)]
    fn turn_afresh(&self, state: &mut MonitorState<R>, initial: &InitialState) {
        state.sin_cos = self.angle(initial, state.foreseen).sin_cos_poly();
    }

    /// The controller's step at the start of its period, and the motor's steps within it.
    #[inline(always)]
    fn control_period(&self, state: &mut MonitorState<R>, initial: &InitialState, setpoint: Setpoint<R>, counted: R) {
        let i_ref = self.ace.step(&mut state.ace, setpoint, counted, state.omega_m);
        state.i_ref = match self.form {
            Form::ThreePhase => {
                let v = self.carrying_voltage(state, i_ref);
                let mean = self.mean_currents(i_ref, v);
                #[cfg(feature = "study")]
                let mean = study::with_table(mean, v, self.derived.per_half_v_dc, state.sin_cos);
                state.pull = state.pull + self.jump(mean[1] - state.i_ref[1], v);
                mean
            }
            Form::Paper(_) | Form::OneAxis => [R::zero(), i_ref],
        };
        for _ in 0..self.steps_per_control {
            self.step(state, initial);
        }
    }

    /// The output follows the motor through the play.
    #[inline(always)]
    fn turn_output(&self, state: &mut MonitorState<R>, initial: &InitialState, theta_m: R) {
        let centre = R::splat(initial.origin.play_centre) + theta_m * self.derived.per_gear;
        state.theta_out = follow_through_play(state.theta_out, centre, self.half_play);
    }

    /// Direct and quadrature voltage that carries a reference steadily round, V.
    #[inline(always)]
    fn carrying_voltage(&self, state: &MonitorState<R>, i_ref: R) -> [R; 2] {
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

    /// Mean direct and quadrature current that the comparators hold for a reference, A, under the voltage that carries it.
    #[inline(always)]
    fn mean_currents(&self, i_ref: R, [v_d, v_q]: [R; 2]) -> [R; 2] {
        // Never zero, which has no direction.
        let length = (v_d * v_d + v_q * v_q + R::splat(1e-12)).sqrt();
        let per_volt = self.ripple.shortfall(length * self.derived.per_half_v_dc) / length;
        [-per_volt * v_d, i_ref - per_volt * v_q]
    }

    /// What of the pull, A, a step seems to start with already, because the quadrature current, switched to the rails, changes by
    /// `change` in its first share `f` and waits: `(1 − f) Σ N_j/2 Δi_q`. Its mean torque is then that of both ends.
    ///
    /// `f = L |Δi_q| / (Δt (√(v_max² − v_d²) ∓ v_q))`, at most one, v being the voltage that carries the new reference: what is
    /// left along q drives the change, and the back-EMF helps one against itself. v_max is the mean over all angles of what the
    /// inverter's hexagon reaches, L the mean of the phases'. Derived here.
    #[inline(always)]
    fn jump(&self, change: R, [v_d, v_q]: [R; 2]) -> R {
        let m = &self.derived;
        let reach = (m.v_max_squared - v_d * v_d).max(R::zero()).sqrt();
        // Both sides of the fraction times |Δi_q|, which makes the sign of v_q that of its product.
        let driving = reach * change.abs() - v_q * change;
        let share = change * change * m.mean_ohms / driving.max(R::splat(1e-6));
        (R::splat(1.0) - share.min(R::splat(1.0))) * m.pull_per_amp * change
    }

    /// One integration step: currents to the predicted angle, then mechanics with the mean torque of both ends.
    #[inline(always)]
    fn step(&self, state: &mut MonitorState<R>, initial: &InitialState) {
        let m = &self.derived;
        let half = R::splat(0.5);
        let omega = state.omega_m;
        let omega_mid = omega + half * state.gained;
        let ahead = state.theta_m + omega_mid * m.dt;
        let sin_cos = R::rotate(state.sin_cos, m.pole_pairs * (ahead - state.foreseen));
        state.foreseen = ahead;

        let torque = match self.form {
            Form::ThreePhase => {
                let shapes = self.winding.emf_shapes(sin_cos);
                let volts = m.half_back_emf * omega_mid;
                let emf = per_phase!(|j| (state.emf_shapes[j] + shapes[j]) * volts);
                let target = abc_from_alpha_beta(alpha_beta_from_dq(state.i_ref, sin_cos));
                state.i = three_phase::step(m, state.i, target, emf);
                state.emf_shapes = shapes;
                let before = state.pull;
                state.pull = pull(shapes, state.i);
                m.half_torque * (before + state.pull)
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

        state.omega_m = self
            .friction
            .long_step(omega, torque - m.viscous * omega, m.dt_over_j, &mut state.slack);
        state.gained = state.omega_m - omega;
        state.theta_m = state.theta_m + (omega + state.omega_m) * m.half_dt;
        if self.feedback == Feedback::Simulated {
            self.turn_output(state, initial, state.theta_m);
        }
    }

    /// Advances the equivalent phase and gives the mean torque of the step.
    #[inline(always)]
    fn one_axis(&self, state: &mut MonitorState<R>, shape: &DerivedShape<R>, omega: R) -> R {
        let before = state.i_q;
        state.i_q = one_axis::step(&self.derived, before, state.i_ref[1], shape, omega, state.sin_cos);
        R::splat(0.75) * self.derived.torque * shape.emf * (before + state.i_q)
    }
}

/// Σ over the phases of back-EMF shape times current, A.
#[inline(always)]
fn pull<R: Real>([a, b, c]: [R; 3], [i_a, i_b, i_c]: [R; 3]) -> R {
    a * i_a + b * i_b + c * i_c
}

/// Where the output stands at one of the control periods from one sample to the next, rad: it turns as the motor does.
#[inline(always)]
#[must_use]
pub fn output_read(now: &ComparedSample, next: &ComparedSample, control: u32, controls: u32) -> f64 {
    let share = share_of_turn(now, next, f64::from(control) / f64::from(controls));
    now.theta_read + share * (next.theta_read - now.theta_read)
}

/// Share of the turn from one sample to the next that the motor has made at `x` of the time between them, from the cubic
/// with both angles and speeds; `x` itself where the motor hardly turns.
#[inline(always)]
fn share_of_turn(now: &ComparedSample, next: &ComparedSample, x: f64) -> f64 {
    let rise = next.theta_m - now.theta_m;
    let (leave, arrive) = (now.turning, next.turning);
    // A turn that is not clearly one way has no shares.
    if leave * rise <= 0.0 || arrive * rise <= 0.0 {
        return x;
    }
    x * (leave + x * ((3.0 * rise - 2.0 * leave - arrive) + x * (leave + arrive - 2.0 * rise))) / rise
}

//! Construction of a monitor from parameters, calibration and unknowns; conversion to another number type or to lanes.

use super::ripple::RippleCurve;
use super::{Calibration, Derived, Feedback, Form, Monitor, steps_per_control};
use crate::control::{Ace, Encoder};
use crate::frames::per_phase;
use crate::friction::DryFriction;
use crate::params::ActuatorParams;
use crate::real::Real;
use crate::unknowns::Unknowns;
use crate::winding::Winding;

/// Upper bound of the number of values that [`Monitor::map`] visits.
const MONITOR_NUMBERS: usize = 96;

/// Mean over all angles of the inverter's largest voltage, relative to V_dc: `√3 ln 3 / π`, from the voltage hexagon with an
/// inner radius of 1/√3.
const HEXAGON_MEAN: f64 = 0.605_696_699_608_195_9;

/// Factor on V_dc with which no current of a step needs all of it.
const OUT_OF_REACH: f64 = 1000.0;

impl Monitor<f64> {
    /// A monitor of one actuator with these unknowns, on a DC link of `v_dc`, V. Where the currents follow their references with a time
    /// constant, that stands for the voltage, and its limit is out of reach.
    #[must_use]
    pub fn new(params: &ActuatorParams, calibration: &Calibration, v_dc: f64, unknowns: &Unknowns) -> Self {
        let is_current_controlled = calibration.current_time_constant > 0.0;
        let v_dc = if is_current_controlled {
            OUT_OF_REACH * v_dc
        } else {
            v_dc
        };
        let fault = &unknowns.fault;
        let (motor, transmission) = (&params.motor, &params.transmission);
        let winding = Winding::new(fault);
        let r_s = motor.r_s * (1.0 + unknowns.motor.resistance);
        let k = motor.k * (1.0 + unknowns.motor.back_emf);
        let steps_per_control = steps_per_control(params);
        let dt = params.controller.period / f64::from(steps_per_control);
        let r = winding.turns_ratio.map(|n| n * r_s);
        let ohms: [f64; 3] =
            core::array::from_fn(|j| winding.turns_ratio[j] * winding.turns_ratio[j] * motor.l_s / dt + 0.5 * r[j]);
        let ohms_before = per_phase!(|j| ohms[j] - r[j]);
        let siemens = ohms.map(|x| 1.0 / x);
        let sum: f64 = siemens.iter().sum();
        let friction = DryFriction::new(transmission, fault, unknowns.load_torque);
        let torque = k * calibration.torque;
        let torque_current_per_amp = 0.5 * winding.turns_ratio.iter().sum::<f64>();
        Self {
            form: calibration.form,
            feedback: Feedback::default(),
            ace: Ace::new(params, fault.gain_factor()).with_gradual_anti_windup(params),
            encoder: Encoder::new(params.sensors.output_lsb()),
            friction: match calibration.form {
                Form::ThreePhase => {
                    let peak = calibration.ripple.peak * params.controller.hysteresis;
                    friction.under_pulsating_torque(torque * torque_current_per_amp * peak)
                }
                Form::Paper(_) | Form::OneAxis => friction,
            },
            winding,
            half_play: 0.5 * transmission.backlash * fault.backlash_factor(),
            ripple: RippleCurve::new(&calibration.ripple, params.controller.hysteresis, winding.turns_ratio),
            derived: Derived {
                dt,
                half_dt: 0.5 * dt,
                per_dt: 1.0 / dt,
                dt_over_j: dt / motor.j,
                viscous: motor.c,
                per_gear: 1.0 / transmission.gear_ratio,
                pole_pairs: motor.pole_pairs,
                v_dc,
                half_v_dc: 0.5 * v_dc,
                per_half_v_dc: 2.0 / v_dc,
                v_max_squared: (HEXAGON_MEAN * v_dc) * (HEXAGON_MEAN * v_dc),
                mean_ohms: motor.l_s * winding.turns_ratio.map(|n| n * n).iter().sum::<f64>() / (3.0 * dt),
                phase_r: r_s,
                phase_l: motor.l_s,
                back_emf: k * calibration.back_emf,
                half_back_emf: 0.5 * k * calibration.back_emf,
                torque,
                half_torque: 0.5 * torque,
                current_left: if is_current_controlled {
                    libm::exp(-params.controller.period / calibration.current_time_constant)
                } else {
                    0.0
                },
                torque_current_per_amp,
                r,
                reactance: winding.turns_ratio.map(|n| motor.pole_pairs * n * n * motor.l_s),
                ohms,
                ohms_before,
                siemens,
                star_ohms: 1.0 / sum,
                star_ohms_without: siemens.map(|s| 1.0 / (sum - s)),
            },
            steps_per_control,
            controls_per_sample: libm::round(1.0 / (params.sensors.sample_rate * params.controller.period)) as u32,
            torque_gain: motor.torque_gain(),
            integral: unknowns.integral,
        }
    }
}

impl<R: Real> Monitor<R> {
    /// The monitor in another number type, one value at a time: `monitor.map(|x| x as f32)` on the target.
    #[must_use]
    pub fn map<S: Real>(self, mut f: impl FnMut(R) -> S) -> Monitor<S> {
        let d = self.derived;
        Monitor {
            form: self.form,
            feedback: self.feedback,
            ace: self.ace.map(&mut f),
            encoder: self.encoder.map(&mut f),
            friction: self.friction.map(&mut f),
            winding: self.winding.map(&mut f),
            half_play: f(self.half_play),
            ripple: self.ripple.map(&mut f),
            derived: Derived {
                dt: f(d.dt),
                half_dt: f(d.half_dt),
                per_dt: f(d.per_dt),
                dt_over_j: f(d.dt_over_j),
                viscous: f(d.viscous),
                per_gear: f(d.per_gear),
                pole_pairs: f(d.pole_pairs),
                v_dc: f(d.v_dc),
                half_v_dc: f(d.half_v_dc),
                per_half_v_dc: f(d.per_half_v_dc),
                v_max_squared: f(d.v_max_squared),
                mean_ohms: f(d.mean_ohms),
                phase_r: f(d.phase_r),
                phase_l: f(d.phase_l),
                back_emf: f(d.back_emf),
                half_back_emf: f(d.half_back_emf),
                torque: f(d.torque),
                half_torque: f(d.half_torque),
                current_left: f(d.current_left),
                torque_current_per_amp: f(d.torque_current_per_amp),
                r: d.r.map(&mut f),
                reactance: d.reactance.map(&mut f),
                ohms: d.ohms.map(&mut f),
                ohms_before: d.ohms_before.map(&mut f),
                siemens: d.siemens.map(&mut f),
                star_ohms: f(d.star_ohms),
                star_ohms_without: d.star_ohms_without.map(&mut f),
            },
            steps_per_control: self.steps_per_control,
            controls_per_sample: self.controls_per_sample,
            torque_gain: f(self.torque_gain),
            integral: f(self.integral),
        }
    }

    /// Monitors of the same actuator as one monitor of several lanes; `lane` converts one value of all monitors to lanes.
    ///
    /// Form, feedback and timing are those of the first monitor.
    #[must_use]
    pub fn side_by_side<S: Real, const N: usize>(monitors: &[Self; N], lane: impl Fn([R; N]) -> S) -> Monitor<S> {
        // Collect the values of each monitor in the order of `map`; then `map` again, to replace them by lanes.
        let mut numbers = [[R::zero(); N]; MONITOR_NUMBERS];
        for (n, monitor) in monitors.iter().enumerate() {
            let mut place = 0;
            let _ = monitor.map(|x| {
                numbers[place][n] = x;
                place += 1;
                x
            });
        }
        let mut place = 0;
        monitors[0].map(|_| {
            place += 1;
            lane(numbers[place - 1])
        })
    }
}

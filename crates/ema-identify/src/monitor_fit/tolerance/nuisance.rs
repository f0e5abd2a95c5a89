//! The nuisances of a window: what the tolerances of a type leave open, one number each, in standard deviations.
//!
//! A nuisance changes a parameter of the monitor, or its load, or puts a disturbance torque on its shaft, or changes the measured
//! signals, or the latter two together ([`Action`]).

use ema_models::{
    ActuatorParams, Conditions, FRICTION_TEMPERATURE_SPAN_K, REFERENCE_TEMPERATURE_DEG_C, Scale, Tolerances,
};

/// Number of nuisances.
pub(crate) const NUISANCE_COUNT: usize = 40;

/// Numbers of nuisances that act as a fault does.
pub(super) const DYNAMIC_FRICTION: usize = 3;
pub(super) const STATIC_FRICTION: usize = 4;
pub(super) const FRICTION_TEMPERATURE: usize = 5;
pub(super) const BACKLASH: usize = 6;
pub(super) const POSITION_GAIN: usize = 11;

/// Number of the link voltage.
pub(super) const LINK_VOLTAGE: usize = 10;

/// Number of the load that grows with the output angle.
pub(super) const SPRING: usize = 19;

/// The actuator as the monitor takes it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hardware {
    pub(super) params: ActuatorParams,
    /// DC link voltage, V.
    pub(super) v_dc: f64,
}

/// What a nuisance acts on.
#[derive(Clone, Copy, Debug)]
pub(super) enum Action {
    /// A parameter, by a share of its value.
    Parameter(fn(&mut Hardware, f64)),
    /// The healthy backlash, by a share of its value; wear adds to it.
    Backlash,
    /// A disturbance torque: its place among the disturbances.
    Torque(usize),
    /// A change of the load: its place among the changes of the load.
    Load(usize),
    /// The measured signals: the place among the changes of signals.
    Signals(usize),
    /// Both.
    TorqueAndSignals(usize, usize),
}

/// One nuisance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nuisance {
    /// Its standard deviation.
    sigma: fn(&Known<'_>) -> f64,
    pub(super) action: Action,
}

/// What the standard deviations follow from.
struct Known<'a> {
    tolerances: &'a Tolerances,
    params: &'a ActuatorParams,
    /// Distance of the temperature from that of the data sheet, in 80 K.
    temperature: f64,
}

/// Standard deviation of a temperature that is not measured, K.
const TEMPERATURE_SIGMA_K: f64 = 45.0;

/// Standard deviation of each nuisance, 0 where it is known.
pub(super) fn sigmas(
    tolerances: &Tolerances,
    params: &ActuatorParams,
    conditions: &Conditions,
) -> [f64; NUISANCE_COUNT] {
    let distance = conditions
        .winding_temp_deg_c
        .map_or(TEMPERATURE_SIGMA_K, |t| (t - REFERENCE_TEMPERATURE_DEG_C).abs());
    let known = Known {
        tolerances,
        params,
        temperature: distance / FRICTION_TEMPERATURE_SPAN_K,
    };
    NUISANCES.map(|nuisance| (nuisance.sigma)(&known))
}

/// Least share of a parameter that is left of it.
const SHARE_MIN: f64 = 0.05;

/// A parameter with a deviation, as a share of its value.
fn deviate(value: &mut f64, share: f64) {
    *value *= (1.0 + share).max(SHARE_MIN);
}

const fn parameter(sigma: fn(&Known<'_>) -> f64, apply: fn(&mut Hardware, f64)) -> Nuisance {
    Nuisance {
        sigma,
        action: Action::Parameter(apply),
    }
}

const fn torque(place: usize, sigma: fn(&Known<'_>) -> f64) -> Nuisance {
    Nuisance {
        sigma,
        action: Action::Torque(place),
    }
}

const fn load(place: usize, sigma: fn(&Known<'_>) -> f64) -> Nuisance {
    Nuisance {
        sigma,
        action: Action::Load(place),
    }
}

const fn signals(place: usize, sigma: fn(&Known<'_>) -> f64) -> Nuisance {
    Nuisance {
        sigma,
        action: Action::Signals(place),
    }
}

const fn torque_and_signals(torque: usize, signals: usize, sigma: fn(&Known<'_>) -> f64) -> Nuisance {
    Nuisance {
        sigma,
        action: Action::TorqueAndSignals(torque, signals),
    }
}

/// Largest torque of the motor, Nm.
fn peak_torque(params: &ActuatorParams) -> f64 {
    params.motor.torque_gain() * params.motor.i_max
}

/// T_s − T_d, Nm.
fn stiction(params: &ActuatorParams) -> f64 {
    params.transmission.friction_static - params.transmission.friction_dynamic
}

/// Share of an offset that one of two orthogonal axes has: three independent phases, Clarke's 2/3.
const OFFSET_PER_AXIS: f64 = 0.816_496_580_927_726;

/// All nuisances, in the order of their numbers.
pub(super) const NUISANCES: [Nuisance; NUISANCE_COUNT] = [
    parameter(|k| k.tolerances.l_s, |h, x| deviate(&mut h.params.motor.l_s, x)),
    parameter(|k| k.tolerances.j, |h, x| deviate(&mut h.params.motor.j, x)),
    parameter(
        |k| libm::hypot(k.tolerances.c, k.tolerances.viscous_temperature * k.temperature),
        |h, x| deviate(&mut h.params.motor.c, x),
    ),
    parameter(
        |k| k.tolerances.friction_dynamic,
        |h, x| {
            deviate(&mut h.params.transmission.friction_dynamic, x);
        },
    ),
    parameter(
        |k| k.tolerances.friction_static,
        |h, x| {
            deviate(&mut h.params.transmission.friction_static, x);
        },
    ),
    parameter(
        |k| k.tolerances.friction_temperature * k.temperature,
        |h, x| {
            deviate(&mut h.params.transmission.friction_dynamic, x);
            deviate(&mut h.params.transmission.friction_static, x);
        },
    ),
    Nuisance {
        sigma: |k| k.tolerances.backlash,
        action: Action::Backlash,
    },
    parameter(
        |k| k.tolerances.efficiency_opposing,
        |h, x| {
            let efficiency = &mut h.params.transmission.efficiency_opposing;
            deviate(efficiency, x);
            *efficiency = efficiency.min(1.0);
        },
    ),
    parameter(
        |k| k.tolerances.efficiency_aiding,
        |h, x| {
            let efficiency = &mut h.params.transmission.efficiency_aiding;
            deviate(efficiency, x);
            *efficiency = efficiency.min(1.0);
        },
    ),
    parameter(|k| k.tolerances.i_max, |h, x| deviate(&mut h.params.motor.i_max, x)),
    parameter(|k| k.tolerances.v_dc, |h, x| deviate(&mut h.v_dc, x)),
    parameter(|k| k.tolerances.g_p, |h, x| deviate(&mut h.params.controller.g_p, x)),
    parameter(|k| k.tolerances.k_p, |h, x| deviate(&mut h.params.controller.k_p, x)),
    parameter(|k| k.tolerances.k_i, |h, x| deviate(&mut h.params.controller.k_i, x)),
    parameter(
        |k| k.tolerances.omega_max,
        |h, x| {
            deviate(&mut h.params.controller.omega_max, x);
        },
    ),
    parameter(
        |k| k.tolerances.hysteresis,
        |h, x| {
            deviate(&mut h.params.controller.hysteresis, x);
        },
    ),
    torque(0, |k| k.tolerances.stribeck * stiction(k.params)),
    torque(1, |k| k.tolerances.cogging * peak_torque(k.params)),
    torque(2, |k| k.tolerances.cogging * peak_torque(k.params)),
    load(0, |k| k.tolerances.spring * Scale::new(k.params).load_unit()),
    load(1, |k| k.tolerances.load_drift * Scale::new(k.params).load_unit()),
    torque(3, |k| k.tolerances.resolver_error),
    torque(4, |k| k.tolerances.resolver_error),
    torque(5, |k| k.tolerances.resolver_error),
    torque(6, |k| k.tolerances.resolver_error),
    torque(7, |k| k.tolerances.emf_harmonics),
    torque(8, |k| k.tolerances.emf_harmonics),
    torque(9, |k| OFFSET_PER_AXIS * k.tolerances.current_offset),
    torque(10, |k| OFFSET_PER_AXIS * k.tolerances.current_offset),
    torque(11, |k| k.tolerances.current_gain),
    torque(12, |k| k.tolerances.current_gain),
    torque(13, |k| k.tolerances.current_gain),
    torque_and_signals(14, 0, |k| k.tolerances.control_latency),
    torque_and_signals(15, 1, |k| k.tolerances.control_latency),
    signals(2, |k| k.tolerances.sample_latency),
    signals(3, |k| k.tolerances.sample_latency),
    signals(4, |k| k.tolerances.encoder_error),
    signals(5, |k| k.tolerances.encoder_error),
    signals(6, |k| k.tolerances.control_latency),
    torque_and_signals(16, 7, |k| k.tolerances.control_latency),
];

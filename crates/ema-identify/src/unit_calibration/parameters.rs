//! Parameters in which a unit differs from its type, and how far units usually do.

use std::format;
use std::string::String;

use ema_models::{ActuatorParams, Tolerances};
use serde::{Deserialize, Serialize};

/// A parameter of a type in which its units differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnitParameter {
    /// Phase resistance R.
    Resistance,
    /// Back-EMF coefficient k.
    BackEmf,
    /// Phase inductance L.
    Inductance,
    /// Inertia J.
    Inertia,
    /// Viscous damping C.
    Damping,
    /// Dry friction, T_d and T_s together.
    DryFriction,
    /// Position gain G_p.
    PositionGain,
    /// Proportional gain K_p of the speed controller.
    SpeedGain,
    /// Integral gain K_i of the speed controller.
    IntegralGain,
    /// Limit ω_max of the speed reference.
    SpeedLimit,
    /// Limit I_max of the current reference.
    CurrentLimit,
}

/// Number of parameters.
pub const UNIT_PARAMETER_COUNT: usize = 11;

impl UnitParameter {
    /// All parameters; the discriminant is the place.
    pub const ALL: [Self; UNIT_PARAMETER_COUNT] = [
        Self::Resistance,
        Self::BackEmf,
        Self::Inductance,
        Self::Inertia,
        Self::Damping,
        Self::DryFriction,
        Self::PositionGain,
        Self::SpeedGain,
        Self::IntegralGain,
        Self::SpeedLimit,
        Self::CurrentLimit,
    ];

    /// Key in a type's section of the configuration.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::Resistance => "motor.phase_resistance_ohm",
            Self::BackEmf => "motor.back_emf_coefficient_v_s_per_rad",
            Self::Inductance => "motor.phase_inductance_h",
            Self::Inertia => "motor.inertia_kg_m2",
            Self::Damping => "motor.viscous_damping_nm_s_per_rad",
            Self::DryFriction => "transmission.dynamic_friction_nm",
            Self::PositionGain => "controller.position_gain_per_s",
            Self::SpeedGain => "controller.speed_proportional_gain_nm_s_per_rad",
            Self::IntegralGain => "controller.speed_integral_gain_nm_per_rad",
            Self::SpeedLimit => "controller.speed_max_rad_s",
            Self::CurrentLimit => "motor.current_max_a",
        }
    }

    /// Name for people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Resistance => "resistance",
            Self::BackEmf => "back-EMF",
            Self::Inductance => "inductance",
            Self::Inertia => "inertia",
            Self::Damping => "viscous damping",
            Self::DryFriction => "dry friction",
            Self::PositionGain => "position gain",
            Self::SpeedGain => "speed gain",
            Self::IntegralGain => "integral gain",
            Self::SpeedLimit => "speed limit",
            Self::CurrentLimit => "current limit",
        }
    }

    /// Whether it is one of the controller's. As found by the monitor it also stands for what its controller lacks, such as a filter of
    /// the speed or a delay.
    #[must_use]
    pub fn is_of_controller(self) -> bool {
        matches!(
            self,
            Self::PositionGain | Self::SpeedGain | Self::IntegralGain | Self::SpeedLimit | Self::CurrentLimit
        )
    }

    /// Tolerance: one standard deviation, as a share of the type's value; the usual one where the type has none of its own.
    #[must_use]
    pub fn tolerance(self, of_type: &Tolerances) -> f64 {
        let of = |tolerances: &Tolerances| match self {
            Self::Resistance => tolerances.r_s,
            Self::BackEmf => tolerances.k,
            Self::Inductance => tolerances.l_s,
            Self::Inertia => tolerances.j,
            Self::Damping => tolerances.c,
            Self::DryFriction => tolerances.friction_dynamic,
            Self::PositionGain => tolerances.g_p,
            Self::SpeedGain => tolerances.k_p,
            Self::IntegralGain => tolerances.k_i,
            Self::SpeedLimit => tolerances.omega_max,
            Self::CurrentLimit => tolerances.i_max,
        };
        let own = of(of_type);
        let has_own = own > 0.0 && own.to_bits() != of(&Tolerances::MOTOR_ONLY).to_bits();
        if has_own { own } else { of(&Tolerances::USUAL) }
    }

    /// The type's value.
    #[must_use]
    pub fn value(self, params: &ActuatorParams) -> f64 {
        let mut params = *params;
        *self.place(&mut params)
    }

    fn place(self, params: &mut ActuatorParams) -> &mut f64 {
        match self {
            Self::Resistance => &mut params.motor.r_s,
            Self::BackEmf => &mut params.motor.k,
            Self::Inductance => &mut params.motor.l_s,
            Self::Inertia => &mut params.motor.j,
            Self::Damping => &mut params.motor.c,
            Self::DryFriction => &mut params.transmission.friction_dynamic,
            Self::PositionGain => &mut params.controller.g_p,
            Self::SpeedGain => &mut params.controller.k_p,
            Self::IntegralGain => &mut params.controller.k_i,
            Self::SpeedLimit => &mut params.controller.omega_max,
            Self::CurrentLimit => &mut params.motor.i_max,
        }
    }
}

/// Deviation of a parameter from its type, as a share of the type's value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Deviation {
    /// The deviation; above −1.
    pub share: f64,
    /// One standard deviation of it.
    pub sigma: f64,
}

/// Deviations of a unit from its type.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitParameters {
    /// Phase resistance.
    pub resistance: Deviation,
    /// Back-EMF coefficient.
    pub back_emf: Deviation,
    /// Phase inductance.
    pub inductance: Deviation,
    /// Inertia.
    pub inertia: Deviation,
    /// Viscous damping.
    pub viscous_damping: Deviation,
    /// Dry friction, dynamic and static.
    pub dry_friction: Deviation,
    /// Position gain.
    pub position_gain: Deviation,
    /// Proportional gain of the speed controller.
    pub speed_gain: Deviation,
    /// Integral gain of the speed controller.
    pub integral_gain: Deviation,
    /// Limit of the speed reference.
    pub speed_limit: Deviation,
    /// Limit of the current reference.
    pub current_limit: Deviation,
    /// Correlation of the sigmas of resistance and back-EMF, above −1 and below 1.
    pub resistance_back_emf_correlation: f64,
}

impl UnitParameters {
    /// The deviation of a parameter.
    #[must_use]
    pub fn of(&self, parameter: UnitParameter) -> Deviation {
        match parameter {
            UnitParameter::Resistance => self.resistance,
            UnitParameter::BackEmf => self.back_emf,
            UnitParameter::Inductance => self.inductance,
            UnitParameter::Inertia => self.inertia,
            UnitParameter::Damping => self.viscous_damping,
            UnitParameter::DryFriction => self.dry_friction,
            UnitParameter::PositionGain => self.position_gain,
            UnitParameter::SpeedGain => self.speed_gain,
            UnitParameter::IntegralGain => self.integral_gain,
            UnitParameter::SpeedLimit => self.speed_limit,
            UnitParameter::CurrentLimit => self.current_limit,
        }
    }

    /// Parameters of the unit, but for resistance and back-EMF, which every window estimates along.
    #[must_use]
    pub fn applied_to(&self, of_type: &ActuatorParams) -> ActuatorParams {
        let mut params = *of_type;
        for parameter in UnitParameter::ALL {
            if !matches!(parameter, UnitParameter::Resistance | UnitParameter::BackEmf) {
                apply(parameter, self.of(parameter).share, &mut params);
            }
        }
        params
    }

    /// The same relative to the type's k: without voltages the scale of all torques is free.
    #[must_use]
    pub fn relative_to_back_emf(mut self) -> Self {
        let scale = 1.0 / (1.0 + self.back_emf.share);
        for torque in [&mut self.inertia, &mut self.viscous_damping, &mut self.dry_friction] {
            torque.share = scale * (1.0 + torque.share) - 1.0;
        }
        self.back_emf.share = 0.0;
        self
    }

    /// What is wrong with the numbers of a file, if anything.
    pub(super) fn defect(&self) -> Option<String> {
        let impossible = UnitParameter::ALL.into_iter().find(|&parameter| {
            let Deviation { share, sigma } = self.of(parameter);
            !(share > -1.0 && share < MAX_SHARE && sigma > 0.0 && sigma.is_finite())
        });
        let correlation = self.resistance_back_emf_correlation;
        if let Some(parameter) = impossible {
            let Deviation { share, sigma } = self.of(parameter);
            Some(format!("a deviation of {} of {share} ± {sigma}", parameter.key()))
        } else if correlation.abs() < 1.0 {
            None
        } else {
            Some(format!("a correlation of {correlation}"))
        }
    }
}

/// Largest deviation that a file may hold.
const MAX_SHARE: f64 = 10.0;

/// Changes a parameter by a share of itself; static friction goes with dynamic friction.
pub(crate) fn apply(parameter: UnitParameter, share: f64, params: &mut ActuatorParams) {
    *parameter.place(params) *= 1.0 + share;
    if parameter == UnitParameter::DryFriction {
        params.transmission.friction_static *= 1.0 + share;
    }
}

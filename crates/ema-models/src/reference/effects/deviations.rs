//! Parameters that differ from the type's values, each by a share of this value: from a type to the parameters of one unit.
//!
//! They need no law of their own in the step. The hardware's deviations change the unit, the controller's change what the
//! controller calculates with; the monitor knows of neither.

use crate::params::ActuatorParams;

/// Relative deviations `value / nominal − 1` of parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviations {
    /// Back-EMF coefficient k.
    pub back_emf: f64,
    /// Phase resistance R.
    pub resistance: f64,
    /// Phase inductance L.
    pub inductance: f64,
    /// Inertia J.
    pub inertia: f64,
    /// Viscous damping C.
    pub viscous: f64,
    /// Dynamic friction torque T_d.
    pub dynamic_friction: f64,
    /// Static friction torque T_s; it is never below T_d.
    pub static_friction: f64,
    /// Backlash b₀.
    pub play: f64,
    /// Gear efficiency η_o; it is limited to 1.
    pub opposing_efficiency: f64,
    /// Gear efficiency η_a; it is limited to 1.
    pub aiding_efficiency: f64,
    /// DC link voltage V_dc.
    pub link_voltage: f64,
    /// Current limit I_max of the controller.
    pub current_limit: f64,
    /// Position gain G_p of the controller.
    pub position_gain: f64,
    /// Proportional gain K_p of the speed loop.
    pub speed_gain: f64,
    /// Integral gain K_i of the speed loop.
    pub integral_gain: f64,
    /// Speed limit ω_max of the controller.
    pub speed_limit: f64,
}

impl Deviations {
    /// The hardware with these deviations.
    #[must_use]
    pub fn hardware(&self, type_params: &ActuatorParams) -> ActuatorParams {
        let mut unit = *type_params;
        let (m, t) = (&mut unit.motor, &mut unit.transmission);
        for (value, deviation) in [
            (&mut m.k, self.back_emf),
            (&mut m.r_s, self.resistance),
            (&mut m.l_s, self.inductance),
            (&mut m.j, self.inertia),
            (&mut m.c, self.viscous),
            (&mut m.v_dc, self.link_voltage),
            (&mut t.friction_dynamic, self.dynamic_friction),
            (&mut t.friction_static, self.static_friction),
            (&mut t.backlash, self.play),
            (&mut t.efficiency_opposing, self.opposing_efficiency),
            (&mut t.efficiency_aiding, self.aiding_efficiency),
        ] {
            *value *= 1.0 + deviation;
        }
        t.friction_static = t.friction_static.max(t.friction_dynamic);
        t.efficiency_opposing = t.efficiency_opposing.min(1.0);
        t.efficiency_aiding = t.efficiency_aiding.min(1.0);
        unit
    }

    /// The parameters with which the controller of the unit calculates.
    #[must_use]
    pub fn controller(&self, type_params: &ActuatorParams) -> ActuatorParams {
        let mut controller = *type_params;
        let c = &mut controller.controller;
        for (value, deviation) in [
            (&mut controller.motor.i_max, self.current_limit),
            (&mut c.g_p, self.position_gain),
            (&mut c.k_p, self.speed_gain),
            (&mut c.k_i, self.integral_gain),
            (&mut c.omega_max, self.speed_limit),
        ] {
            *value *= 1.0 + deviation;
        }
        controller
    }
}

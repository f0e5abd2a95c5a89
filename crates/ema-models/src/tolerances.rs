//! How well each number of an actuator's type is known before anything was learnt of the unit.

/// Difference of temperature that the tolerances of friction belong to, K.
pub const FRICTION_TEMPERATURE_SPAN_K: f64 = 80.0;

/// Tolerances of a type: one standard deviation each.
///
/// Shares are of the parameter's value. [`Tolerances::USUAL`] has those of a data sheet (declared here); with
/// [`Tolerances::MOTOR_ONLY`] every number but R and k is known exactly, with [`Tolerances::NONE`] these too.
///
/// ```
/// use ema_models::Tolerances;
/// assert!(Tolerances::MOTOR_ONLY.are_zero_beside_motor() && !Tolerances::USUAL.are_zero_beside_motor());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerances {
    /// Back-EMF coefficient k, share.
    pub k: f64,
    /// Phase resistance R, share.
    pub r_s: f64,
    /// Phase inductance L, share.
    pub l_s: f64,
    /// Inertia J, share.
    pub j: f64,
    /// Viscous damping C, share.
    pub c: f64,
    /// Largest quadrature current I_max, share.
    pub i_max: f64,
    /// DC link voltage V_dc, measured or not, share.
    pub v_dc: f64,
    /// Amplitude of a cogging torque of 6 P periods per revolution, share of the largest torque.
    pub cogging: f64,
    /// Amplitude of the back-EMF's 5th and of its 7th harmonic, share.
    pub emf_harmonics: f64,
    /// Dynamic friction torque T_d, share.
    pub friction_dynamic: f64,
    /// Static friction torque T_s, share.
    pub friction_static: f64,
    /// Friction beyond T_d at low speed, share of T_s − T_d.
    pub stribeck: f64,
    /// Logarithm of T_d and T_s at a temperature 80 K away from 20 °C; the same at +80 K and at −80 K.
    pub friction_temperature: f64,
    /// The same of C.
    pub viscous_temperature: f64,
    /// Backlash b₀, share.
    pub backlash: f64,
    /// Gear efficiency η_o, share.
    pub efficiency_opposing: f64,
    /// Gear efficiency η_a, share.
    pub efficiency_aiding: f64,
    /// Load that grows with the output angle, share of the largest load per radian.
    pub spring: f64,
    /// Load that grows with time, share of the largest load per second.
    pub load_drift: f64,
    /// Position gain G_p, share.
    pub g_p: f64,
    /// Proportional gain K_p of the speed loop, share.
    pub k_p: f64,
    /// Integral gain K_i of the speed loop, share.
    pub k_i: f64,
    /// Speed saturation ω_max, share.
    pub omega_max: f64,
    /// Half band h of the current comparators, share; a drive without them has none.
    pub hysteresis: f64,
    /// Delay from the measured speed to the current, s.
    pub control_latency: f64,
    /// Gain of a phase current, share.
    pub current_gain: f64,
    /// Offset of a phase current, A.
    pub current_offset: f64,
    /// Age of the currents, and of the angles, at the sample's instant, s.
    pub sample_latency: f64,
    /// Amplitude of the resolver's error of first and of second electrical harmonic, rad electrical.
    pub resolver_error: f64,
    /// Amplitude of the output encoder's error once per revolution, rad.
    pub encoder_error: f64,
}

impl Tolerances {
    /// Every number is known exactly.
    pub const NONE: Self = Self {
        k: 0.0,
        r_s: 0.0,
        l_s: 0.0,
        j: 0.0,
        c: 0.0,
        i_max: 0.0,
        v_dc: 0.0,
        cogging: 0.0,
        emf_harmonics: 0.0,
        friction_dynamic: 0.0,
        friction_static: 0.0,
        stribeck: 0.0,
        friction_temperature: 0.0,
        viscous_temperature: 0.0,
        backlash: 0.0,
        efficiency_opposing: 0.0,
        efficiency_aiding: 0.0,
        spring: 0.0,
        load_drift: 0.0,
        g_p: 0.0,
        k_p: 0.0,
        k_i: 0.0,
        omega_max: 0.0,
        hysteresis: 0.0,
        control_latency: 0.0,
        current_gain: 0.0,
        current_offset: 0.0,
        sample_latency: 0.0,
        resolver_error: 0.0,
        encoder_error: 0.0,
    };

    /// Resistance within ±5 % and back-EMF within ±3 %, as the standard deviations of uniform distributions.
    pub const MOTOR_ONLY: Self = Self {
        r_s: 0.028_867_513_459_481_29,
        k: 0.017_320_508_075_688_773,
        ..Self::NONE
    };

    /// The usual tolerances of a data sheet.
    pub const USUAL: Self = Self {
        k: 0.03,
        r_s: 0.05,
        l_s: 0.07,
        j: 0.05,
        c: 0.5,
        i_max: 0.02,
        v_dc: 0.02,
        cogging: 0.01,
        emf_harmonics: 0.03,
        friction_dynamic: 0.2,
        friction_static: 0.2,
        stribeck: 0.5,
        friction_temperature: 0.5,
        viscous_temperature: 1.4,
        backlash: 0.5,
        efficiency_opposing: 0.1,
        efficiency_aiding: 0.1,
        spring: 0.2,
        load_drift: 0.02,
        g_p: 0.01,
        k_p: 0.01,
        k_i: 0.01,
        omega_max: 0.01,
        hysteresis: 0.5,
        control_latency: 150e-6,
        current_gain: 0.01,
        current_offset: 0.03,
        sample_latency: 50e-6,
        // Ten minutes of arc.
        resolver_error: 2.9e-3,
        encoder_error: 0.5e-3,
    };

    /// Whether nothing but R and k, which are unknowns of every window, has a tolerance.
    #[must_use]
    pub fn are_zero_beside_motor(&self) -> bool {
        let without_motor = Self {
            k: 0.0,
            r_s: 0.0,
            ..*self
        };
        without_motor.are_zero()
    }

    /// Whether every number is known exactly.
    #[must_use]
    pub fn are_zero(&self) -> bool {
        *self == Self::NONE
    }
}

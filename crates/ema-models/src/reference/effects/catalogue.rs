//! The catalogue of effects: for each settable name its unit, usual range, equation and source, and access to its value.
//!
//! Everything that offers effects by name (command line, files, suites, documentation) reads this table.

use core::f64::consts::PI;
use core::fmt;

use super::{Effects, ShortedTurns};
use crate::params::{ActuatorParams, Expected};

/// One settable value.
#[derive(Clone, Copy, Debug)]
pub struct EffectInfo {
    /// Name, with the unit last.
    pub name: &'static str,
    /// Unit of the value; `1` for a ratio or a number.
    pub unit: &'static str,
    /// Range of usual values for `bench`, in which the effect is on; for another type see [`EffectInfo::usual_on`].
    pub usual: (f64, f64),
    /// What the usual range is proportional to.
    pub scale: Scale,
    /// Smallest and largest value that [`Effects::set`] accepts.
    pub limits: (f64, f64),
    /// Whether the value must be a whole number.
    pub whole: bool,
    /// The effect of which this value is a parameter; alone it changes nothing.
    pub part_of: Option<&'static str>,
    /// What it does, with `x` for the value where the equation has no symbol for it.
    pub equation: &'static str,
    /// Where the equation comes from: `[D]` declared here, `derived` derived here, or a key of `docs/references.md`.
    pub source: &'static str,
    get: fn(&Effects) -> Option<f64>,
    set: fn(&mut Effects, f64),
}

/// Quantity of an actuator type that the usual range of an effect is proportional to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// None: the same for every type.
    Absolute,
    /// Largest motor torque G_T I_max.
    PeakTorque,
    /// Largest motor torque at the output, G_T I_max n.
    OutputTorque,
    /// T_s − T_d.
    Stiction,
    /// I_max.
    Current,
    /// V_dc.
    LinkVoltage,
    /// V_dc / I_max.
    LinkResistance,
    /// Phase resistance R.
    PhaseResistance,
    /// Pole pairs P.
    PolePairs,
}

impl Scale {
    fn of(self, params: &ActuatorParams) -> f64 {
        let (m, t) = (&params.motor, &params.transmission);
        match self {
            Self::Absolute => 1.0,
            Self::PeakTorque => m.torque_gain() * m.i_max,
            Self::OutputTorque => m.torque_gain() * m.i_max * t.gear_ratio,
            Self::Stiction => t.friction_static - t.friction_dynamic,
            Self::Current => m.i_max,
            Self::LinkVoltage => m.v_dc,
            Self::LinkResistance => m.v_dc / m.i_max,
            Self::PhaseResistance => m.r_s,
            Self::PolePairs => m.pole_pairs,
        }
    }
}

impl EffectInfo {
    /// Range of usual values for an actuator type, in which the effect is on.
    #[must_use]
    pub fn usual_on(&self, params: &ActuatorParams) -> (f64, f64) {
        let factor = match self.scale {
            Scale::Absolute => 1.0,
            scale => scale.of(params) / scale.of(&ActuatorParams::bench()),
        };
        (self.usual.0 * factor, self.usual.1 * factor)
    }

    /// What a value must be.
    #[must_use]
    pub fn expected(&self) -> Expected {
        Expected::Within(self.limits.0, self.limits.1)
    }

    /// The value, where it differs from that without effect.
    #[must_use]
    pub fn value(&self, effects: &Effects) -> Option<f64> {
        (self.get)(effects)
    }
}

/// Why a value was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EffectError {
    /// No effect has this name; the most similar names, best first.
    Unknown([&'static str; SIMILAR]),
    /// The value is outside its range.
    OutOfRange {
        /// Name of the effect.
        name: &'static str,
        /// The value found.
        got: f64,
        /// What it must be.
        expected: Expected,
    },
}

/// Number of similar names that [`EffectError::Unknown`] lists.
const SIMILAR: usize = 3;

impl fmt::Display for EffectError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown([first, second, third]) => {
                write!(f, "unknown effect: expected a name such as {first}, {second}, {third}")
            }
            Self::OutOfRange {
                name,
                got,
                expected: Expected::Within(min, max),
            } => write!(f, "{name} = {got}: expected a number from {min} to {max}"),
            Self::OutOfRange { name, got, .. } => write!(f, "{name} = {got}: expected a whole number"),
        }
    }
}

impl core::error::Error for EffectError {}

impl Effects {
    /// Sets one value by its name in [`EFFECTS`]. A parameter of the vector drive selects this drive, one of the shorted turns
    /// turns their current on.
    ///
    /// # Errors
    /// An unknown name, with the most similar names, or a value outside its range.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), EffectError> {
        let Some(info) = EFFECTS.iter().find(|info| info.name == name) else {
            return Err(EffectError::Unknown(similar_names(name)));
        };
        let out_of_range = |expected| EffectError::OutOfRange {
            name: info.name,
            got: value,
            expected,
        };
        if !(info.limits.0..=info.limits.1).contains(&value) {
            return Err(out_of_range(info.expected()));
        }
        if info.whole && libm::fabs(value - libm::round(value)) > 0.0 {
            return Err(out_of_range(Expected::MultipleOf(1.0)));
        }
        (info.set)(self, value);
        Ok(())
    }

    /// Name and value of everything that is on, in the order of [`EFFECTS`]; of a vector drive all parameters.
    ///
    /// Setting these values on effects that are off gives the same effects.
    pub fn active(&self) -> impl Iterator<Item = (&'static str, f64)> + '_ {
        EFFECTS.iter().filter_map(|info| Some((info.name, info.value(self)?)))
    }
}

/// The names with the smallest edit distance, best first.
fn similar_names(name: &str) -> [&'static str; SIMILAR] {
    let mut best = [("", usize::MAX); SIMILAR];
    for info in EFFECTS {
        let mut candidate = (info.name, edit_distance(name, info.name));
        for place in &mut best {
            if candidate.1 < place.1 {
                core::mem::swap(place, &mut candidate);
            }
        }
    }
    best.map(|(name, _)| name)
}

/// Insertions, deletions and replacements from one name to another, of their first 63 bytes (Levenshtein's distance).
fn edit_distance(from: &str, to: &str) -> usize {
    const LENGTH: usize = 64;
    let cut = |text: &'_ str| text.len().min(LENGTH - 1);
    let (from, to) = (&from.as_bytes()[..cut(from)], &to.as_bytes()[..cut(to)]);
    let mut row: [usize; LENGTH] = core::array::from_fn(|n| n);
    for (i, a) in from.iter().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, b) in to.iter().enumerate() {
            let replaced = diagonal + usize::from(a != b);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[to.len()]
}

/// `value` where it differs from `off`.
fn unless(value: f64, off: f64) -> Option<f64> {
    (libm::fabs(value - off) > 0.0).then_some(value)
}

/// One row of [`EFFECTS`]; the last item says where the value is.
macro_rules! effect {
    (
        $name:literal, $unit:literal, usual $usual:expr => $scale:ident, within $limits:expr, $number:ident, $part_of:expr,
        $equation:literal, $source:literal, $($place:tt)+
    ) => {
        EffectInfo {
            name: $name,
            unit: $unit,
            usual: $usual,
            scale: Scale::$scale,
            limits: $limits,
            whole: effect!(@whole $number),
            part_of: $part_of,
            equation: $equation,
            source: $source,
            get: effect!(@get $($place)+),
            set: effect!(@set $($place)+),
        }
    };
    (@whole whole) => { true };
    (@whole real) => { false };
    (@get field $($field:tt)+) => { |e| unless(e.$($field)+, Effects::default().$($field)+) };
    (@set field $($field:tt)+) => { |e, x| e.$($field)+ = x };
    (@get drive $field:ident) => { |e| e.vector_drive().map(|drive| drive.$field) };
    (@set drive $field:ident) => { |e, x| e.drive.change_vector(|drive| drive.$field = x) };
    (@get short $field:ident) => { |e| e.shorted_turns.map(|turns| turns.$field) };
    (@set short $field:ident) => { |e, x| e.shorted_turns.get_or_insert(ShortedTurns::default()).$field = x };
    (@get flag $($field:tt)+) => { |e| e.$($field)+.then_some(1.0) };
    (@set flag $($field:tt)+) => { |e, x| e.$($field)+ = x > 0.5 };
}

/// Every settable value, in the order of the families.
pub const EFFECTS: &[EffectInfo] = &[
    effect!(
        "pwm_frequency_hz", "Hz", usual (8000.0, 4e4) => Absolute, within (2000.0, 1e5), real, None,
        "T_p = 1/f; currents sampled and voltages updated once per T_p, one T_p late", "[D]", drive pwm_frequency
    ),
    effect!(
        "current_bandwidth_hz", "Hz", usual (400.0, 1200.0) => Absolute, within (10.0, 5000.0), real, None,
        "K_p = 2πf L, K_i = 2πf R", "[D]", drive bandwidth
    ),
    effect!(
        "dead_time_s", "s", usual (5e-7, 2e-6) => Absolute, within (0.0, 5e-6), real, None,
        "mean of v_j falls by V_dc (t_d/T_p) sign i_j", "derived", drive dead_time
    ),
    effect!(
        "dead_time_compensation", "1", usual (0.0, 1.0) => Absolute, within (0.0, 1.5), real, Some("dead_time_s"),
        "share of V_dc (t_d/T_p) sign i_j added to the reference", "[D]", drive dead_time_compensation
    ),
    effect!(
        "decoupling", "1", usual (0.0, 0.8) => Absolute, within (0.0, 1.0), real, None,
        "share of −ω_e L i_q, ω_e L i_d + k ω_m added to v_d, v_q", "derived", drive decoupling
    ),
    effect!(
        "field_weakening_a", "A", usual (1.0, 3.0) => Current, within (0.0, 1000.0), real, None,
        "i_d* falls to at most −I while the voltage does not suffice", "[D]", drive field_weakening
    ),
    effect!(
        "back_emf_deviation", "1", usual (-0.075, 0.075) => Absolute, within (-0.9, 9.0), real, None,
        "k (1 + x)", "[D]", field deviations.back_emf
    ),
    effect!(
        "resistance_deviation", "1", usual (-0.1, 0.1) => Absolute, within (-0.9, 9.0), real, None,
        "R (1 + x)", "[D]", field deviations.resistance
    ),
    effect!(
        "inductance_deviation", "1", usual (-0.1, 0.1) => Absolute, within (-0.9, 9.0), real, None,
        "L (1 + x)", "[D]", field deviations.inductance
    ),
    effect!(
        "inertia_deviation", "1", usual (-0.1, 0.1) => Absolute, within (-0.9, 9.0), real, None,
        "J (1 + x)", "[D]", field deviations.inertia
    ),
    effect!(
        "viscous_deviation", "1", usual (-0.5, 0.5) => Absolute, within (-0.9, 9.0), real, None,
        "C (1 + x)", "[D]", field deviations.viscous
    ),
    effect!(
        "dynamic_friction_deviation", "1", usual (-0.2, 0.2) => Absolute, within (-0.9, 9.0), real, None,
        "T_d (1 + x)", "[D]", field deviations.dynamic_friction
    ),
    effect!(
        "static_friction_deviation", "1", usual (-0.2, 0.2) => Absolute, within (-0.9, 9.0), real, None,
        "T_s (1 + x)", "[D]", field deviations.static_friction
    ),
    effect!(
        "play_deviation", "1", usual (-0.5, 0.5) => Absolute, within (-0.9, 9.0), real, None,
        "b₀ (1 + x)", "[D]", field deviations.play
    ),
    effect!(
        "opposing_efficiency_deviation", "1", usual (-0.1, 0.1) => Absolute, within (-0.9, 9.0), real, None,
        "η_o (1 + x)", "[D]", field deviations.opposing_efficiency
    ),
    effect!(
        "aiding_efficiency_deviation", "1", usual (-0.1, 0.1) => Absolute, within (-0.9, 9.0), real, None,
        "η_a (1 + x)", "[D]", field deviations.aiding_efficiency
    ),
    effect!(
        "link_voltage_deviation", "1", usual (-0.02, 0.02) => Absolute, within (-0.9, 9.0), real, None,
        "V_dc (1 + x)", "[D]", field deviations.link_voltage
    ),
    effect!(
        "current_limit_deviation", "1", usual (-0.02, 0.02) => Absolute, within (-0.9, 9.0), real, None,
        "I_max (1 + x)", "[D]", field deviations.current_limit
    ),
    effect!(
        "position_gain_deviation", "1", usual (-0.01, 0.01) => Absolute, within (-0.9, 9.0), real, None,
        "G_p (1 + x)", "[D]", field deviations.position_gain
    ),
    effect!(
        "speed_gain_deviation", "1", usual (-0.01, 0.01) => Absolute, within (-0.9, 9.0), real, None,
        "K_p (1 + x)", "[D]", field deviations.speed_gain
    ),
    effect!(
        "integral_gain_deviation", "1", usual (-0.01, 0.01) => Absolute, within (-0.9, 9.0), real, None,
        "K_i (1 + x)", "[D]", field deviations.integral_gain
    ),
    effect!(
        "speed_limit_deviation", "1", usual (-0.01, 0.01) => Absolute, within (-0.9, 9.0), real, None,
        "ω_max (1 + x)", "[D]", field deviations.speed_limit
    ),
    effect!(
        "setpoint_rate_rad_s", "rad/s", usual (0.5, 3.0) => Absolute, within (0.0, 1000.0), real, None,
        "position setpoint moves by at most x Δt per control period", "[D]", field controller.setpoint_rate
    ),
    effect!(
        "speed_setpoint_rate_rad_s2", "rad/s²", usual (1000.0, 1e4) => Absolute, within (0.0, 1e7), real, None,
        "speed setpoint moves by at most x Δt per control period", "[D]", field controller.speed_setpoint_rate
    ),
    effect!(
        "speed_filter_hz", "Hz", usual (300.0, 1000.0) => Absolute, within (0.0, 1e4), real, None,
        "differenced resolver counts through 1/(1 + s/2πf)", "[D]", field controller.speed_filter
    ),
    effect!(
        "control_delay_periods", "1", usual (1.0, 1.0) => Absolute, within (0.0, 3.0), whole, None,
        "I_ref applied x control periods late", "[D]", field controller.delay
    ),
    effect!(
        "compliance_hz", "Hz", usual (40.0, 400.0) => Absolute, within (0.0, 2000.0), real, None,
        "K = (2πf)² J_m J_l/(J_m + J_l)", "derived", field compliance.resonance
    ),
    effect!(
        "compliance_damping", "1", usual (0.01, 0.1) => Absolute, within (0.0, 1.0), real, Some("compliance_hz"),
        "D = 2 x 2πf J_m J_l/(J_m + J_l)", "derived", field compliance.damping_ratio
    ),
    effect!(
        "load_inertia_share", "1", usual (0.1, 0.4) => Absolute, within (0.01, 0.99), real, Some("compliance_hz"),
        "J_l = x J, J_m = (1 − x) J", "[D]", field compliance.load_inertia
    ),
    effect!(
        "load_friction_share", "1", usual (0.0, 0.5) => Absolute, within (0.0, 1.0), real, Some("compliance_hz"),
        "share of T_d and T_s on the load side", "[D]", field compliance.load_friction
    ),
    effect!(
        "stribeck_nm", "Nm", usual (0.05, 0.15) => Stiction, within (0.0, 1e4), real, None,
        "T_d + x exp(−(ω/ω_s)²) while moving", "[Armstrong]", field friction.stribeck
    ),
    effect!(
        "stribeck_speed_rad_s", "rad/s", usual (5.0, 30.0) => Absolute, within (0.1, 1000.0), real, Some("stribeck_nm"),
        "ω_s", "[Armstrong]", field friction.stribeck_speed
    ),
    effect!(
        "viscous_temperature", "1", usual (1.0, 3.0) => Absolute, within (0.0, 99.0), real, Some("temperature_rise_k"),
        "C (1 + x)^((20 °C − T)/80 K)", "[D]", field friction.viscous_temperature
    ),
    effect!(
        "dry_temperature", "1", usual (0.2, 1.0) => Absolute, within (0.0, 99.0), real, Some("temperature_rise_k"),
        "T_d, T_s (1 + x)^((20 °C − T)/80 K)", "[D]", field friction.dry_temperature
    ),
    effect!(
        "temperature_rise_k", "K", usual (-60.0, 60.0) => Absolute, within (-80.0, 200.0), real, None,
        "T = scenario + x; R, k, C, T_d, T_s follow T", "[D]", field friction.temperature_rise
    ),
    effect!(
        "mesh_ripple", "1", usual (0.05, 0.1) => Absolute, within (0.0, 0.9), real, None,
        "T_d, T_s (1 + x sin N_t θ_m)", "[D]", field friction.mesh_ripple
    ),
    effect!(
        "gear_teeth", "1", usual (7.0, 23.0) => Absolute, within (1.0, 500.0), whole, Some("mesh_ripple"),
        "N_t per motor revolution", "[D]", field friction.teeth
    ),
    effect!(
        "cogging_nm", "Nm", usual (0.03, 0.29) => PeakTorque, within (0.0, 1e4), real, None,
        "T_c sin(N_c θ_m + φ)", "[D]", field cogging.torque
    ),
    effect!(
        "cogging_periods", "1", usual (24.0, 24.0) => PolePairs, within (0.0, 500.0), whole, Some("cogging_nm"),
        "N_c; 0 for 6 P", "[D]", field cogging.periods
    ),
    effect!(
        "cogging_phase_rad", "rad", usual (-PI, PI) => Absolute, within (-7.0, 7.0), real, Some("cogging_nm"),
        "φ", "[D]", field cogging.phase
    ),
    effect!(
        "unmeasured_load_nm", "Nm", usual (-50.0, 50.0) => OutputTorque, within (-1e6, 1e6), real, None,
        "T_l + x", "[D]", field load.constant
    ),
    effect!(
        "spring_nm_per_rad", "Nm/rad", usual (50.0, 500.0) => OutputTorque, within (0.0, 1e6), real, None,
        "T_l + x (θ_out − θ_out(0))", "[D]", field load.spring
    ),
    effect!(
        "load_drift_nm", "Nm", usual (10.0, 40.0) => OutputTorque, within (0.0, 1e6), real, None,
        "T_l + x sin 2πt/τ", "[D]", field load.drift
    ),
    effect!(
        "load_drift_period_s", "s", usual (5.0, 30.0) => Absolute, within (0.1, 1e5), real, Some("load_drift_nm"),
        "τ", "[D]", field load.drift_period
    ),
    effect!(
        "emf_5", "1", usual (0.01, 0.05) => Absolute, within (-0.3, 0.3), real, None,
        "k_j + k N_j x (−sin 5θ_j)", "[D]", field motor.harmonic_5
    ),
    effect!(
        "emf_7", "1", usual (0.01, 0.03) => Absolute, within (-0.3, 0.3), real, None,
        "k_j + k N_j x (−sin 7θ_j)", "[D]", field motor.harmonic_7
    ),
    effect!(
        "saturation", "1", usual (0.05, 0.2) => Absolute, within (0.0, 0.8), real, None,
        "L_j (1 − x min(1, i_j²/I_max²))", "[D]", field motor.saturation
    ),
    effect!(
        "current_gain_a", "1", usual (-0.01, 0.01) => Absolute, within (-0.5, 0.5), real, None,
        "i_A (1 + x)", "[D]", field sensors.current_gain[0]
    ),
    effect!(
        "current_gain_b", "1", usual (-0.01, 0.01) => Absolute, within (-0.5, 0.5), real, None,
        "i_B (1 + x)", "[D]", field sensors.current_gain[1]
    ),
    effect!(
        "current_gain_c", "1", usual (-0.01, 0.01) => Absolute, within (-0.5, 0.5), real, None,
        "i_C (1 + x)", "[D]", field sensors.current_gain[2]
    ),
    effect!(
        "current_offset_a_a", "A", usual (-0.05, 0.05) => Current, within (-100.0, 100.0), real, None,
        "i_A + x", "[D]", field sensors.current_offset[0]
    ),
    effect!(
        "current_offset_b_a", "A", usual (-0.05, 0.05) => Current, within (-100.0, 100.0), real, None,
        "i_B + x", "[D]", field sensors.current_offset[1]
    ),
    effect!(
        "current_offset_c_a", "A", usual (-0.05, 0.05) => Current, within (-100.0, 100.0), real, None,
        "i_C + x", "[D]", field sensors.current_offset[2]
    ),
    effect!(
        "current_filter_hz", "Hz", usual (1000.0, 5000.0) => Absolute, within (0.0, 1e5), real, None,
        "samples of i_j through 1/(1 + s/2πf)", "[D]", field sensors.current_filter
    ),
    effect!(
        "two_current_sensors", "1", usual (1.0, 1.0) => Absolute, within (0.0, 1.0), whole, None,
        "i_C = −i_A − i_B", "[D]", flag sensors.two_current_sensors
    ),
    effect!(
        "current_latency_s", "s", usual (2e-5, 1e-4) => Absolute, within (0.0, 5e-4), real, None,
        "samples hold i(t − x)", "[D]", field sensors.current_latency
    ),
    effect!(
        "angle_latency_s", "s", usual (2e-5, 1e-4) => Absolute, within (0.0, 5e-4), real, None,
        "samples hold θ(t − x)", "[D]", field sensors.angle_latency
    ),
    effect!(
        "sample_jitter", "1", usual (0.05, 0.2) => Absolute, within (0.0, 0.45), real, None,
        "sampled at t + u/f_s, u uniform in ±x", "[D]", field sensors.sample_jitter
    ),
    effect!(
        "resolver_error_1_rad", "rad", usual (0.002, 0.0058) => Absolute, within (0.0, 0.2), real, None,
        "θ_e + x sin(θ_e + φ) seen", "[D]", field sensors.resolver_1.amplitude
    ),
    effect!(
        "resolver_phase_1_rad", "rad", usual (-PI, PI) => Absolute, within (-7.0, 7.0), real, Some("resolver_error_1_rad"),
        "φ", "[D]", field sensors.resolver_1.phase
    ),
    effect!(
        "resolver_error_2_rad", "rad", usual (0.002, 0.0058) => Absolute, within (0.0, 0.2), real, None,
        "θ_e + x sin(2θ_e + φ) seen", "[D]", field sensors.resolver_2.amplitude
    ),
    effect!(
        "resolver_phase_2_rad", "rad", usual (-PI, PI) => Absolute, within (-7.0, 7.0), real, Some("resolver_error_2_rad"),
        "φ", "[D]", field sensors.resolver_2.phase
    ),
    effect!(
        "encoder_eccentricity_rad", "rad", usual (2e-4, 5e-4) => Absolute, within (0.0, 0.05), real, None,
        "θ_out + x sin(θ_out + φ) seen", "[D]", field sensors.encoder_eccentricity
    ),
    effect!(
        "encoder_phase_rad", "rad", usual (-PI, PI) => Absolute, within (-7.0, 7.0), real, Some("encoder_eccentricity_rad"),
        "φ", "[D]", field sensors.encoder_phase
    ),
    effect!(
        "link_resistance_ohm", "Ω", usual (0.5, 2.0) => LinkResistance, within (0.0, 100.0), real, None,
        "V_dc − x i_dc, 0.05 to 2 V_dc; i_dc smoothed over 1 ms", "[D]", field link.resistance
    ),
    effect!(
        "link_ripple_v", "V", usual (4.0, 19.0) => LinkVoltage, within (0.0, 1000.0), real, None,
        "V_dc + x sin 2πft", "[D]", field link.ripple
    ),
    effect!(
        "link_ripple_hz", "Hz", usual (300.0, 2400.0) => Absolute, within (1.0, 2e4), real, Some("link_ripple_v"),
        "f", "[D]", field link.ripple_frequency
    ),
    effect!(
        "short_resistance_ohm", "Ω", usual (0.0, 1.0) => PhaseResistance, within (0.0, 1e6), real, None,
        "σR i_f + R_f (i_f − i_j) + σ²L di_f/dt + cNσL di_j/dt + σe_j = 0", "derived", short resistance
    ),
    effect!(
        "short_coupling", "1", usual (0.8, 0.98) => Absolute, within (0.0, 1.0), real, Some("short_resistance_ohm"),
        "c", "[D]", short coupling
    ),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_can_be_set_and_read_alone() {
        for info in EFFECTS {
            let mut effects = Effects::default();
            assert!(info.value(&effects).is_none(), "{} is on by default", info.name);
            let value = info.usual.1;
            effects.set(info.name, value).unwrap();
            assert_eq!(info.value(&effects), Some(value), "{}", info.name);
            assert!(!effects.are_off(), "{}", info.name);
            let mut copy = Effects::default();
            for (name, value) in effects.active() {
                copy.set(name, value).unwrap();
            }
            assert_eq!(copy, effects, "{}", info.name);
            if let Some(part_of) = info.part_of {
                assert!(EFFECTS.iter().any(|other| other.name == part_of), "{}", info.name);
            }
        }
    }

    #[test]
    fn usual_ranges_lie_within_the_limits_on_both_built_in_types() {
        for params in [ActuatorParams::bench(), ActuatorParams::servo28()] {
            for info in EFFECTS {
                let (min, max) = info.usual_on(&params);
                assert!(
                    info.limits.0 <= min && min <= max && max <= info.limits.1,
                    "{}",
                    info.name
                );
            }
        }
        let single = EFFECTS.iter().filter(|info| info.part_of.is_none());
        assert!(single.count() >= 40);
    }

    #[test]
    fn names_are_unique() {
        for (n, info) in EFFECTS.iter().enumerate() {
            assert!(
                EFFECTS[..n].iter().all(|other| other.name != info.name),
                "{}",
                info.name
            );
        }
    }

    #[test]
    fn refusals_name_what_was_expected() {
        let mut effects = Effects::default();
        let Err(EffectError::Unknown(similar)) = effects.set("coging_nm", 0.1) else {
            panic!("a misspelt name was accepted");
        };
        assert_eq!(similar[0], "cogging_nm");
        for bad in [f64::NAN, f64::INFINITY, -1.0] {
            assert!(matches!(
                effects.set("cogging_nm", bad),
                Err(EffectError::OutOfRange { name: "cogging_nm", .. })
            ));
        }
        assert!(effects.set("control_delay_periods", 0.5).is_err());
        assert!(effects.are_off());
    }
}

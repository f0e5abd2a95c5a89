//! Units that nobody knows but by their data sheet and ten recordings: drawn, commissioned, and assessed healthy and worn.

#[path = "one_window.rs"]
mod one_window;

use std::error::Error;
use std::f64::consts::PI;
use std::sync::Arc;

use ema_models::reference::{Actuations, CurrentSensing, Drive, Effects, Scenario};
use ema_models::{FaultId, FaultVector, Profile, Tolerances};
use hmd_core::assess::{AssessedWindow, Assessor, Models};
use hmd_core::commissioning::calibrate_unit;
use hmd_core::config::{Config, ConfigError};
use hmd_core::outbox::WindowJob;
use hmd_core::seed::mix;
pub(crate) use one_window::window_of;
use rayon::prelude::*;

/// Damages of the worn windows.
const DAMAGES: [f64; 2] = [0.15, 0.3];

/// Deviations are drawn within this many tolerances.
const WITHIN: f64 = 2.0;

/// How units are tried.
pub(crate) struct Trial {
    /// With one actuator, whose calibration is in a file.
    pub(crate) config: Arc<Config>,
    /// Healthy windows after commissioning.
    pub(crate) windows: u64,
    /// Windows of each fault and damage.
    pub(crate) worn: u64,
    /// Recordings to commission.
    pub(crate) learn: u64,
    /// Resonance of the transmission, 0 for a rigid one.
    pub(crate) compliance_hz: f64,
}

impl Trial {
    /// With a vector drive told by its kind alone, and the numbers of windows of a full trial.
    pub(crate) fn of_type(type_name: &str) -> Result<Self, ConfigError> {
        let text = format!(
            "[[actuator]]\nid = 0\ntype = \"{type_name}\"\ncalibration = \"unit\"\n\
             [type.{type_name}.drive]\nkind = \"vector\"\n"
        );
        Ok(Self {
            config: Arc::new(Config::from_toml_str(&text, "new_unit")?),
            windows: 200,
            worn: 3,
            learn: 10,
            compliance_hz: 0.0,
        })
    }

    /// Draws, commissions and assesses a unit.
    pub(crate) fn unit(&self, seed: u64) -> Result<Tally, Box<dyn Error>> {
        let effects = self.effects(seed)?;
        let mut recordings: Vec<WindowJob> = (0..self.learn)
            .into_par_iter()
            .filter_map(|n| {
                self.window(effects, FaultVector::NOMINAL, mix(seed, &[2, n]))
                    .transpose()
            })
            .collect::<Result<_, String>>()?;
        recordings.retain(|job| job.window.quality.is_fit());
        let of_type = Models::load_types(&self.config, &|_| Ok(String::new()))?;
        let before: Vec<bool> = recordings
            .par_iter()
            .map(|job| Assessor::new(self.config.clone(), of_type.clone(), 1).assess(job.clone()))
            .map(|assessed| {
                assessed.map(|assessed| {
                    if !assessed.health.faults.is_empty() {
                        eprintln!("before: {} {:?}", assessed.health.faults, assessed.health.estimate());
                    }
                    !assessed.health.faults.is_empty()
                })
            })
            .collect::<Result<_, _>>()?;
        let assessor = Assessor::new(self.config.clone(), of_type, 1);
        let levels = self.config.health().levels();
        let learnt = calibrate_unit(&assessor, levels, &mut recordings, 1, &|_| ())?;
        let text = learnt.calibration.emit();
        let models = Models::load(&self.config, &|_| Ok(text.clone()))?;

        let healthy = (0..self.windows).map(|n| (None, FaultVector::NOMINAL, mix(seed, &[3, n])));
        let kinds = FaultId::ALL
            .into_iter()
            .flat_map(|fault| DAMAGES.map(|damage| (fault, damage)));
        let worn = kinds.enumerate().flat_map(|(kind, (fault, damage))| {
            (0..self.worn).map(move |n| {
                let case_seed = mix(seed, &[4, kind as u64, n]);
                let mut k = FaultVector::NOMINAL.to_array();
                // A gain drifts to either side: half its range is a damage of one.
                k[fault.parameter()] += if fault == FaultId::Gain { 0.5 * damage } else { damage };
                k[FaultVector::ECCENTRICITY_PHASE_INDEX] = uniform(case_seed, 0.0, 1.0);
                (Some(fault), FaultVector::from_array(k), case_seed)
            })
        });
        let cases: Vec<_> = healthy.chain(worn).collect();
        let tallies: Vec<Tally> = cases
            .into_par_iter()
            .map(|(fault, truth, case_seed)| {
                let job = self
                    .window(effects, truth, case_seed)?
                    .ok_or("expected a window, found none")?;
                let assessed = Assessor::new(self.config.clone(), models.clone(), 1).assess(job);
                Ok(Tally::of(&assessed.map_err(|error| error.to_string())?, fault, &truth))
            })
            .collect::<Result<_, String>>()?;
        let mut sum = Tally {
            before: before.len() as u64,
            accused_before: before.iter().map(|&is_accused| u64::from(is_accused)).sum(),
            ..Tally::default()
        };
        tallies.into_iter().for_each(|tally| sum.add(tally));
        Ok(sum)
    }

    fn window(&self, effects: Effects, fault: FaultVector, seed: u64) -> Result<Option<WindowJob>, String> {
        let params = self.config.actuators()[0].params;
        let scenario = Scenario {
            effects,
            sensing: CurrentSensing {
                quantised: true,
                noise_rms: 0.003 * params.motor.i_max,
            },
            actuations: Actuations::single(Profile::Mixed),
            ..Scenario::new(params, fault, seed)
        };
        let mut job = window_of(&self.config, &scenario).map_err(|error| error.to_string())?;
        if let Some(job) = &mut job {
            // Nobody measures the load.
            job.conditions.load_torque_nm = None;
        }
        Ok(job)
    }

    /// What the unit has besides its data sheet.
    fn effects(&self, seed: u64) -> Result<Effects, Box<dyn Error>> {
        let tolerances = Tolerances::USUAL;
        let mut effects = Effects {
            drive: Drive::of_type(&self.config.actuators()[0].drive),
            ..Effects::default()
        };
        let mut drawn = 0;
        let mut next = || {
            drawn += 1;
            mix(seed, &[1, drawn])
        };
        // T_d and T_s have one lubricant.
        let friction = normal(next());
        for (name, tolerance) in [
            ("back_emf_deviation", tolerances.k),
            ("resistance_deviation", tolerances.r_s),
            ("inductance_deviation", tolerances.l_s),
            ("inertia_deviation", tolerances.j),
            ("viscous_deviation", 0.8 * tolerances.c),
            ("play_deviation", 0.8 * tolerances.backlash),
            ("opposing_efficiency_deviation", tolerances.efficiency_opposing),
            ("aiding_efficiency_deviation", tolerances.efficiency_aiding),
            ("current_limit_deviation", tolerances.i_max),
            ("link_voltage_deviation", tolerances.v_dc),
            ("position_gain_deviation", tolerances.g_p),
            ("speed_gain_deviation", tolerances.k_p),
            ("integral_gain_deviation", tolerances.k_i),
            ("speed_limit_deviation", tolerances.omega_max),
            ("current_gain_a", tolerances.current_gain),
            ("current_gain_b", tolerances.current_gain),
            ("current_gain_c", tolerances.current_gain),
            ("current_offset_a_a", tolerances.current_offset),
            ("current_offset_b_a", tolerances.current_offset),
            ("current_offset_c_a", tolerances.current_offset),
        ] {
            effects.set(name, tolerance * normal(next()))?;
        }
        effects.set("dynamic_friction_deviation", tolerances.friction_dynamic * friction)?;
        effects.set("static_friction_deviation", tolerances.friction_static * friction)?;
        for (name, low, high) in [
            ("dead_time_s", 0.5e-6, 2e-6),
            ("spring_nm_per_rad", 50.0, 200.0),
            ("cogging_nm", 0.03, 0.14),
            ("cogging_phase_rad", -PI, PI),
            ("resolver_error_1_rad", 1e-3, 4e-3),
            ("resolver_phase_1_rad", -PI, PI),
            ("resolver_error_2_rad", 1e-3, 4e-3),
            ("resolver_phase_2_rad", -PI, PI),
        ] {
            effects.set(name, uniform(next(), low, high))?;
        }
        if self.compliance_hz > 0.0 {
            effects.set("compliance_hz", self.compliance_hz)?;
        }
        Ok(effects)
    }
}

/// Uniform in a range, of a seed.
fn uniform(seed: u64, low: f64, high: f64) -> f64 {
    low + (high - low) * (seed >> 11) as f64 / (1u64 << 53) as f64
}

/// Standard normal within [`WITHIN`], of a seed.
fn normal(seed: u64) -> f64 {
    let (radius, angle) = (
        uniform(mix(seed, &[1]), 1e-12, 1.0),
        uniform(mix(seed, &[2]), 0.0, 2.0 * PI),
    );
    ((-2.0 * radius.ln()).sqrt() * angle.cos()).clamp(-WITHIN, WITHIN)
}

/// Counts of windows.
#[derive(Default)]
pub(crate) struct Tally {
    /// Recordings, assessed before commissioning, and those that accuse a part.
    pub(crate) before: u64,
    pub(crate) accused_before: u64,
    pub(crate) healthy: u64,
    pub(crate) judged: u64,
    pub(crate) accused: u64,
    pub(crate) worn: u64,
    pub(crate) named: u64,
    pub(crate) within: u64,
    pub(crate) errors: Vec<f64>,
}

impl Tally {
    fn of(assessed: &AssessedWindow, fault: Option<FaultId>, truth: &FaultVector) -> Self {
        let health = &assessed.health;
        let is_judged = matches!(health.status.as_str(), "ok" | "degraded");
        let mut tally = Self::default();
        let Some(fault) = fault else {
            tally.healthy = 1;
            tally.judged = u64::from(is_judged);
            tally.accused = u64::from(!health.faults.is_empty());
            if !health.faults.is_empty() {
                eprintln!("healthy, but {}: {:?}", health.faults, health.estimate());
            }
            return tally;
        };
        tally.worn = 1;
        tally.named = u64::from(health.faults == fault.name());
        if let Some(estimate) = health.estimate() {
            let place = fault.parameter();
            let error = (estimate.k[place] - truth.to_array()[place]).abs();
            tally.errors.push(error);
            tally.within = u64::from(estimate.sigma[place].is_some_and(|sigma| error <= 2.0 * sigma));
        }
        if tally.named == 0 {
            eprintln!(
                "{} {truth:?} as {} {:?} {}",
                fault.name(),
                health.faults,
                health.estimate(),
                health.reason
            );
        }
        tally
    }

    pub(crate) fn add(&mut self, other: Self) {
        self.before += other.before;
        self.accused_before += other.accused_before;
        self.healthy += other.healthy;
        self.judged += other.judged;
        self.accused += other.accused;
        self.worn += other.worn;
        self.named += other.named;
        self.within += other.within;
        self.errors.extend(other.errors);
    }

    pub(crate) fn line(&self) -> String {
        let mut errors = self.errors.clone();
        errors.sort_by(f64::total_cmp);
        let median = errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN);
        format!(
            "before: {} windows, {} false; healthy: {} windows, {} judged, {} false; worn: {} windows, {} named, {} within two sigmas, median error {median:.4}",
            self.before,
            self.accused_before,
            self.healthy,
            self.judged,
            self.accused,
            self.worn,
            self.named,
            self.within
        )
    }
}

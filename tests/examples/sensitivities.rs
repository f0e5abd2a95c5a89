//! How much each number of a data sheet matters: `cargo run --release -p hmd-tests --example sensitivities [TYPE]`.
//!
//! For each parameter the error with which a healthy actuator seems to have a damage of 0.02, where the configuration claims that
//! every number is exact. The reference simulates the actuator with the error, the whole chain assesses it; the apparent damage is
//! the mean over windows of the largest component's change, of the worse sign of the error. An error with which a window is unmodelled costs
//! too much as well. Prints the table of `docs/data-sheet.md`.

#[path = "../one_window.rs"]
mod one_window;

use std::error::Error;
use std::sync::Arc;

use ema_models::reference::{Actuations, CurrentSensing, Drive, EFFECTS, EffectInfo, Effects, Scenario};
use ema_models::{FaultId, FaultVector, Profile, Tolerances};
use hmd_core::assess::{Assessor, Models};
use hmd_core::config::Config;
use one_window::window_of;
use rayon::prelude::*;

/// Windows over which the apparent damage is averaged.
const WINDOWS: u64 = 8;

/// Damage that an error may cost.
const DAMAGE: f64 = 0.02;

/// Rounds in which the error approaches the one that costs [`DAMAGE`], and how near it must come.
const ROUNDS: u32 = 8;
const NEAR: f64 = 0.1;

/// Largest error tried, usual tolerances.
const TOLERANCES_MAX: f64 = 10.0;

/// A parameter: the effect that changes it, its name in the table, and its usual tolerance.
struct Parameter {
    effect: &'static str,
    name: &'static str,
    tolerance: fn(&Tolerances) -> f64,
}

const fn parameter(effect: &'static str, name: &'static str, tolerance: fn(&Tolerances) -> f64) -> Parameter {
    Parameter {
        effect,
        name,
        tolerance,
    }
}

/// Shares of the type's value but for the offset and the latency.
const PARAMETERS: [Parameter; 18] = [
    parameter("dynamic_friction_deviation", "dynamic friction T_d", |t| {
        t.friction_dynamic
    }),
    parameter("static_friction_deviation", "static friction T_s", |t| {
        t.friction_static
    }),
    parameter("viscous_deviation", "viscous damping C", |t| t.c),
    parameter("play_deviation", "backlash b₀", |t| t.backlash),
    parameter("opposing_efficiency_deviation", "gear efficiency η_o", |t| {
        t.efficiency_opposing
    }),
    parameter("aiding_efficiency_deviation", "gear efficiency η_a", |t| {
        t.efficiency_aiding
    }),
    parameter("inertia_deviation", "inertia J", |t| t.j),
    parameter("back_emf_deviation", "back-EMF coefficient k", |t| t.k),
    parameter("resistance_deviation", "phase resistance R", |t| t.r_s),
    parameter("inductance_deviation", "phase inductance L", |t| t.l_s),
    parameter("current_limit_deviation", "current limit I_max", |t| t.i_max),
    parameter("link_voltage_deviation", "DC link voltage V_dc", |t| t.v_dc),
    parameter("position_gain_deviation", "position gain G_p", |t| t.g_p),
    parameter("speed_gain_deviation", "speed gain K_p", |t| t.k_p),
    parameter("speed_limit_deviation", "speed limit ω_max", |t| t.omega_max),
    parameter("current_gain_a", "gain of one current sensor", |t| t.current_gain),
    parameter("current_offset_a_a", "offset of one current sensor, A", |t| {
        t.current_offset
    }),
    parameter("current_latency_s", "latency of the currents, s", |t| t.sample_latency),
];

fn main() -> Result<(), Box<dyn Error>> {
    let type_name = std::env::args().nth(1).unwrap_or_else(|| "bench".to_owned());
    let bench = Bench::new(&type_name)?;
    let sound = bench.damages(bench.sound())?.ok_or("healthy windows are modelled")?;
    let rows: Vec<String> = PARAMETERS
        .par_iter()
        .map(|parameter| bench.row(parameter, &sound).map_err(|error| error.to_string()))
        .collect::<Result<_, String>>()?;
    println!("| parameter | usual tolerance | error that costs {DAMAGE} | seems to be |");
    println!("|---|---|---|---|");
    for row in rows {
        println!("{row}");
    }
    Ok(())
}

type Damages = [f64; FaultId::COUNT];

/// An actuator type of which every number is claimed to be exact.
struct Bench {
    config: Arc<Config>,
    models: Models,
}

impl Bench {
    fn new(type_name: &str) -> Result<Self, Box<dyn Error>> {
        let text =
            format!("[[actuator]]\nid = 0\ntype = \"{type_name}\"\n[type.{type_name}]\ntolerances = \"exact\"\n");
        let config = Arc::new(Config::from_toml_str(&text, "sensitivities")?);
        let models = Models::without_files(&config)?;
        Ok(Self { config, models })
    }

    /// The effects of an actuator that is its type: its drive alone.
    fn sound(&self) -> Effects {
        Effects {
            drive: Drive::of_type(&self.config.actuators()[0].drive),
            ..Effects::default()
        }
    }

    /// The row of one parameter.
    fn row(&self, parameter: &Parameter, sound: &[Damages]) -> Result<String, Box<dyn Error>> {
        let info: &EffectInfo = EFFECTS
            .iter()
            .find(|info| info.name == parameter.effect)
            .ok_or("an effect of the catalogue")?;
        let tolerance = (parameter.tolerance)(&Tolerances::USUAL);
        let most = TOLERANCES_MAX * tolerance;
        let mut error = tolerance;
        // The largest error that costs less, and the smallest that costs too much with what it seems to be.
        let (mut below, mut above) = (0.0, None);
        for _ in 0..ROUNDS {
            let apparent = self.apparent(info, error, sound)?;
            let guess = match apparent {
                Some((damage, _)) => error * (DAMAGE / damage).clamp(0.25, 4.0),
                None => 0.5 * error,
            };
            match apparent {
                Some((damage, _)) if damage < DAMAGE => below = error,
                costly => above = Some((error, costly.map(|(_, fault)| fault))),
            }
            let highest = above.map_or(most, |(error, _)| error);
            if below > (1.0 - NEAR) * highest {
                break;
            }
            let margin = 0.5 * NEAR * (highest - below);
            error = match above {
                Some(_) => guess.clamp(below + margin, highest - margin),
                None => guess.min(most),
            };
        }
        let shown = |value: f64| match info.unit {
            "1" => format!("{:.1} %", 100.0 * value),
            "s" => format!("{:.0} µs", 1e6 * value),
            unit => format!("{:.0} m{unit}", 1e3 * value),
        };
        let (cost, part) = match above {
            Some((error, Some(fault))) => (shown(error), fault.plain_name()),
            Some((error, None)) => (shown(error), "unmodelled"),
            None => (format!("over {}", shown(below)), "–"),
        };
        Ok(format!(
            "| {} | {} | {cost} | {part} |",
            parameter.name,
            shown(tolerance)
        ))
    }

    /// Apparent damage by an error of a parameter, and of which fault; of the worse sign. `None` where a window is unmodelled.
    fn apparent(
        &self,
        info: &EffectInfo,
        error: f64,
        sound: &[Damages],
    ) -> Result<Option<(f64, FaultId)>, Box<dyn Error>> {
        let mut worst = (0.0, FaultId::ALL[0]);
        for signed in [error, -error] {
            let mut effects = self.sound();
            // Some have one sign only.
            if effects.set(info.name, signed).is_err() {
                continue;
            }
            let Some(found) = self.damages(effects)? else {
                return Ok(None);
            };
            for (place, fault) in FaultId::ALL.into_iter().enumerate() {
                let changes = found
                    .iter()
                    .zip(sound)
                    .map(|(found, sound)| found[place] - sound[place]);
                let mean = changes.sum::<f64>().abs() / WINDOWS as f64;
                if mean > worst.0 {
                    worst = (mean, fault);
                }
            }
        }
        Ok(Some(worst))
    }

    /// Damage that healthy windows of an actuator with these effects seem to have; `None` where one is unmodelled.
    fn damages(&self, effects: Effects) -> Result<Option<Vec<Damages>>, Box<dyn Error>> {
        let actuator = &self.config.actuators()[0];
        (0..WINDOWS)
            .map(|seed| {
                let scenario = Scenario {
                    effects,
                    sensing: CurrentSensing {
                        quantised: true,
                        noise_rms: 0.003 * actuator.params.motor.i_max,
                    },
                    actuations: Actuations::single(Profile::Mixed),
                    ..Scenario::new(actuator.params, FaultVector::NOMINAL, seed + 1)
                };
                let job = window_of(&self.config, &scenario)?.ok_or("a window")?;
                let assessed = Assessor::new(self.config.clone(), self.models.clone(), 1).assess(job)?;
                let estimate = assessed.health.estimate();
                Ok(estimate.map(|estimate| FaultVector::from_array(estimate.k).damages()))
            })
            .collect()
    }
}

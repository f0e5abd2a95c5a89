//! How well the phase currents of a window of `robust` show a damage: `cargo run --release -p hmd-lab --example robust_bound --
//! RATE_HZ [ENTRY]…`; without an entry, all.
//!
//! The Cramér–Rao bound of a fit that knows the unit, every effect on it and every number but the eight fault parameters: the
//! square root of the damaged element's place on the diagonal of (Jᵀ J / σ²)⁻¹, with the sensitivities J of the three currents by
//! differences of the reference without noise, and σ² of the suite's noise and of the bus's resolution of 1 mA. The angles would lower
//! it further. Printed per entry, over the built-in types, six directions of damage of 0.15 and [`WINDOWS`] windows of each.

use std::error::Error;
use std::f64::consts::TAU;

use ema_models::FaultVector;
use ema_models::reference::{CurrentSensing, Scenario};
use hmd_lab::evaluate::robust::{CatalogueUnit, entry_names};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

/// Windows of each unit and direction.
const WINDOWS: u64 = 2;

/// Damage at which the currents are differentiated: the suite's least.
const DAMAGE: f64 = 0.15;

/// Half the step of the differences.
const STEP: f64 = 0.01;

/// Seed of the units, as in the suite.
const SEED: u64 = 1;

/// Fault parameters with the eccentricity as two components, so that none of them is without meaning on a healthy actuator.
type Point = [f64; 8];

/// Places of the point that are damaged in turn: friction, backlash, the shorts, eccentricity, gain.
const DIRECTIONS: [(usize, &str); 7] = [
    (0, "friction"),
    (1, "backlash"),
    (2, "short A"),
    (3, "short B"),
    (4, "short C"),
    (5, "eccentricity"),
    (7, "gain"),
];

fn main() -> Result<(), Box<dyn Error>> {
    let mut given = std::env::args().skip(1);
    let rate_hz: f64 = given.next().unwrap_or_else(|| "2000".to_owned()).parse()?;
    let chosen: Vec<String> = given.collect();
    let entries: Vec<&str> = entry_names()
        .filter(|name| chosen.is_empty() || chosen.iter().any(|chosen| chosen == name))
        .collect();
    let heads: Vec<&str> = DIRECTIONS.iter().map(|(_, name)| *name).collect();
    println!("| entry | {} |", heads.join(" | "));
    println!("|{}", "---|".repeat(1 + heads.len()));
    let rows: Vec<String> = entries
        .par_iter()
        .map(|entry| row(entry, rate_hz).map_err(|error| error.to_string()))
        .collect::<Result<_, String>>()?;
    rows.iter().for_each(|row| println!("{row}"));
    Ok(())
}

/// Largest bound of each direction, over types and windows.
fn row(entry: &str, rate_hz: f64) -> Result<String, Box<dyn Error>> {
    let mut worst = [0.0_f64; DIRECTIONS.len()];
    for actuator in ["bench", "servo28", "servo270"] {
        let unit = CatalogueUnit::new(entry, actuator, rate_hz, SEED)?;
        for window in 0..WINDOWS {
            let scenario = unit.window(window, WINDOWS).1;
            for ((place, name), worst) in DIRECTIONS.iter().zip(&mut worst) {
                let bound =
                    bound(&scenario, *place).ok_or_else(|| format!("{entry}, {actuator}: {name} does not show"))?;
                *worst = worst.max(bound);
            }
        }
    }
    let cells: Vec<String> = worst.iter().map(|bound| format!("{bound:.5}")).collect();
    Ok(format!("| {entry} | {} |", cells.join(" | ")))
}

/// The bound of a damage at this place, whose unit is the damage.
fn bound(scenario: &Scenario, place: usize) -> Option<f64> {
    let mut at: Point = [0.0; 8];
    at[7] = FaultVector::NOMINAL.to_array()[7];
    // Half as much of the controller gain is the same damage.
    let per_damage = if place == 7 { 0.5 } else { 1.0 };
    at[place] += per_damage * DAMAGE;
    let columns: Vec<Vec<f64>> = (0..at.len())
        .map(|column| {
            let (mut low, mut high) = (at, at);
            // An undamaged element can only grow worse.
            if column == place || column > 4 {
                low[column] -= STEP;
            }
            high[column] += STEP;
            let width = high[column] - low[column];
            let pairs = currents(scenario, &high).into_iter().zip(currents(scenario, &low));
            pairs.map(|(high, low)| (high - low) / width).collect()
        })
        .collect();
    let noise = scenario.sensing.noise_rms;
    let variance = noise * noise + 1e-6 / 12.0;
    let information: SMatrix<f64, 8, 8> = (0..columns[0].len())
        .map(|row| SVector::<f64, 8>::from_fn(|column, _| columns[column][row]))
        .map(|sensitivity| sensitivity * sensitivity.transpose() / variance)
        .sum();
    let covariance = information.try_inverse()?;
    Some(covariance[(place, place)].sqrt() / per_damage)
}

/// Currents of the three phases in turn, A, without noise.
fn currents(scenario: &Scenario, at: &Point) -> Vec<f64> {
    let mut k = FaultVector::NOMINAL.to_array();
    k[..5].copy_from_slice(&at[..5]);
    k[5] = at[5].hypot(at[6]);
    k[6] = (at[6].atan2(at[5]) / TAU).rem_euclid(1.0);
    k[7] = at[7];
    let exact = Scenario {
        fault: FaultVector::from_array(k),
        sensing: CurrentSensing {
            quantised: false,
            noise_rms: 0.0,
        },
        ..*scenario
    };
    exact.run().flat_map(|sample| sample.currents).collect()
}

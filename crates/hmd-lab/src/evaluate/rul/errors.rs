//! Errors of estimates, as the `noise` suite found them.

use ema_models::{FAULT_COUNT, FaultVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;

use hmd_core::health::{FAULTS, INDEX};

/// The stored table: a line for each window at 2 kHz, under the command that made it.
const STORED: &str = include_str!("noise_errors.jsonl");

/// A fault below this damage was not there; what is estimated then is cut off at 0.
const PRESENT: f64 = 0.02;

#[derive(Deserialize)]
struct Row {
    truth: [f64; FAULT_COUNT],
    k: [f64; FAULT_COUNT],
    sigma: [Option<f64>; FAULT_COUNT],
}

/// Errors of damage with the standard deviation stated, for each fault where it was present.
pub(super) struct ErrorTable {
    /// Error and sigma; `None` where the window did not show the fault.
    rows: [Vec<Option<(f64, f64)>>; FAULTS],
}

impl ErrorTable {
    pub(super) fn stored() -> Result<Self, serde_json::Error> {
        let mut rows: [Vec<_>; FAULTS] = Default::default();
        for line in STORED.lines().filter(|line| !line.starts_with('#')) {
            let row: Row = serde_json::from_str(line)?;
            let [truth, found] = [row.truth, row.k].map(|k| FaultVector::from_array(k).damage());
            for (fault, &p) in INDEX.iter().enumerate() {
                if truth[p] >= PRESENT {
                    // The damage of the gain is twice its distance from nominal.
                    let scale = if p == 7 { 2.0 } else { 1.0 };
                    rows[fault].push(row.sigma[p].map(|sigma| (found[p] - truth[p], scale * sigma)));
                }
            }
        }
        Ok(Self { rows })
    }

    pub(super) fn draw(&self, fault: usize, rng: &mut ChaCha8Rng) -> Option<(f64, f64)> {
        let rows = &self.rows[fault];
        rows[rng.random_range(0..rows.len())]
    }
}

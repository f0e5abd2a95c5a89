//! Shorted turns in a closed loop: the current that they carry, and what it takes from the torque of their phase.
//!
//! A share σ of the turns of phase j is bridged by R_f and carries i_f:
//! `0 = σR i_f + R_f (i_f − i_j) + σ²L i_f' + c N σ L i_j' + σ e_j`; the phase's torque is `k s_j (N i_j + σ i_f)`. With the difference
//! `w = σ (i_j − i_f)` and the admittance `β = σ² / (σR + R_f)` this is
//!
//! `w + β L w' = β (R i_j + e_j) + β c' L i_j'`, `c' = c + (1 − c) σ`, and the torque `k s_j (i_j − w)`.
//!
//! So the loop acts as a branch of resistance 1/β and inductance L across the healthy phase. All but β is measured: of a healthy
//! phase the balance differs by `−k s_j w(β)`. Neither σ nor R_f stands in it but by c'. With the low-pass
//! filter `F = 1/(1 + β L s)`,
//!
//! `w = c' i_j + F (β (R i_j + e_j) − c' i_j)`, `∂w/∂β = (c' F i_j + F² (β (R i_j + e_j) − c' i_j)) / β`.
//!
//! The filter runs in the rotor's frame, where its inputs are slow; a step at constant speed is exact. Derived here.

use ema_models::{ActuatorParams, MotorParams, abc_from_alpha_beta, alpha_beta_from_dq, dq_from_abc, phase_shapes};

use super::between_samples::instants;
use super::sample_reading::SampleReading;

/// c' of a usual short: coupling 0.8 to 0.98, σ about a quarter.
const COUPLING: f64 = 0.92;

/// Largest bridge resistance, as a share of the phase's: the usual range of the reference, 0 to 1 Ω of 2.75 Ω.
const MAX_BRIDGE: f64 = 1.0 / 2.75;

/// Bridge resistances over which the share of shorted turns is averaged.
const BRIDGES: usize = 16;

/// Turns of one phase in a closed loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ShortedLoop {
    /// The phase: 0, 1, 2 for A, B, C.
    pub(super) phase: usize,
    /// Admittance β, 1/Ω, above zero.
    pub(super) admittance: f64,
}

/// Share of shorted turns of a loop, as far as its admittance tells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ShortedShare {
    /// Mean of σ over the bridge resistance.
    pub(super) mean: f64,
    /// Its standard deviation.
    pub(super) deviation: f64,
    /// Change of the mean per change of β, Ω.
    pub(super) slope: f64,
}

impl ShortedShare {
    /// Share for an admittance `β`, phase resistance r: with `b = β R` and `ρ = R_f/R`, `σ = (b + √(b² + 4 b ρ))/2`.
    ///
    /// Before the window every σ and every ρ up to [`MAX_BRIDGE`] is as probable; given β, ρ has the density
    /// `∂σ/∂b = (σ + ρ)² / (σ (σ + 2ρ))`. Derived here.
    pub(super) fn of(admittance: f64, r: f64) -> Self {
        let b = (admittance * r).max(f64::MIN_POSITIVE);
        let (mut sum, mut shares, mut squares, mut slopes) = (0.0, 0.0, 0.0, 0.0);
        for m in 0..BRIDGES {
            let rho = MAX_BRIDGE * (m as f64 + 0.5) / BRIDGES as f64;
            let share = 0.5 * (b + libm::sqrt(b * b + 4.0 * b * rho));
            if share > 1.0 {
                break;
            }
            let slope = (share + rho) * (share + rho) / (share * (share + 2.0 * rho));
            sum += slope;
            shares += slope * share;
            squares += slope * share * share;
            slopes += slope * slope;
        }
        if sum <= 0.0 {
            // More than all turns.
            return Self {
                mean: 1.0,
                deviation: 0.0,
                slope: r,
            };
        }
        let mean = shares / sum;
        Self {
            mean,
            deviation: libm::sqrt((squares / sum - mean * mean).max(0.0)),
            slope: r * slopes / sum,
        }
    }
}

/// A number of the rotor's frame, d and q.
type Phasor = [f64; 2];

/// What a loop puts in place of the turns of its phase, sample by sample over a window.
pub(super) struct LoopTorque {
    shorted: ShortedLoop,
    /// Intact turns of the healthy phase.
    turns: f64,
    r: f64,
    k: f64,
    pole_pairs: f64,
    /// Steps of the filters from sample to sample where products are means; else 0, and one step.
    instants: usize,
    /// Duration of a step, s.
    duration: f64,
    /// Time constant β L, s.
    time_constant: f64,
    /// What is left of a current after a step, 1.
    decay: f64,
    /// Current at the last instant.
    current: Phasor,
    /// `F i`, `F (β (R i + e) − c' i)`, and that again behind F.
    filtered: [Phasor; 3],
    /// What the last interval adds to the mean around its end.
    rising: [f64; 2],
}

impl LoopTorque {
    /// Before the first sample, without current; the healthy phase has this turns ratio, and the actuator's motor is as warm as `motor`.
    pub(super) fn new(shorted: ShortedLoop, turns: f64, motor: &MotorParams, params: &ActuatorParams) -> Self {
        let instants = instants(params);
        let time_constant = shorted.admittance * motor.l_s;
        let duration = 1.0 / (params.sensors.sample_rate * instants.max(1) as f64);
        Self {
            shorted,
            turns,
            r: motor.r_s,
            k: motor.k,
            pole_pairs: motor.pole_pairs,
            instants,
            duration,
            time_constant,
            decay: libm::exp(-duration / time_constant),
            current: [0.0; 2],
            filtered: [[0.0; 2]; 3],
            rising: [0.0; 2],
        }
    }

    /// The phase of the loop.
    pub(super) fn phase(&self) -> usize {
        self.shorted.phase
    }

    /// At the next sample: the term whose coefficient is β, and the rest of the phase's torque, Nm. Where the products of samples alias, the
    /// means around the sample.
    pub(super) fn next(&mut self, sample: &SampleReading) -> [f64; 2] {
        let Some(interval) = &sample.interval else {
            let now = &sample.now;
            self.advance(sample.turned, dq_from_abc(now.i, now.sin_cos_e));
            return self.torques(now.sin_cos_e);
        };
        let step = 1.0 / self.instants as f64;
        let mut falling = [0.0; 2];
        let before = core::mem::replace(&mut self.rising, [0.0; 2]);
        for m in 0..self.instants {
            let share = (m as f64 + 0.5) * step;
            let now = interval.at(share);
            let turned = now.angle_in_turn - interval.angle_in_turn_at(share - step);
            self.advance(turned, dq_from_abc(now.i, now.sin_cos_e));
            for (place, torque) in self.torques(now.sin_cos_e).into_iter().enumerate() {
                falling[place] += (1.0 - share) * step * torque;
                self.rising[place] += share * step * torque;
            }
        }
        [before[0] + falling[0], before[1] + falling[1]]
    }

    /// A step of the filters: the motor angle that it turns, rad, and the current at its end.
    fn advance(&mut self, turned: f64, current: Phasor) {
        let turned_e = self.pole_pairs * turned;
        let (duration, decay) = (self.duration, self.decay);
        let kept = [decay * libm::cos(turned_e), -decay * libm::sin(turned_e)];
        // (1 − kept) / (1 + j ω_e β L)
        let lag = turned_e / duration * self.time_constant;
        let square = 1.0 + lag * lag;
        let passed = times([1.0 - kept[0], -kept[1]], [1.0 / square, -lag / square]);
        let mean = [0, 1].map(|axis| 0.5 * (self.current[axis] + current[axis]));
        let emf = [0.0, self.k * turned / duration];
        let beta = self.shorted.admittance;
        let driven = [0, 1].map(|axis| beta * (self.r * mean[axis] + emf[axis]) - COUPLING * mean[axis]);
        let [own, once, twice] = self.filtered;
        let step = |of: Phasor, input: Phasor| {
            let (held, added) = (times(kept, of), times(passed, input));
            [held[0] + added[0], held[1] + added[1]]
        };
        let next = step(once, driven);
        let between = [0, 1].map(|axis| 0.5 * (once[axis] + next[axis]));
        self.filtered = [step(own, mean), next, step(twice, between)];
        self.current = current;
    }

    /// The term whose coefficient is β, and the rest of the phase's torque, linear about the loop's own β.
    fn torques(&self, sin_cos_e: (f64, f64)) -> [f64; 2] {
        let beta = self.shorted.admittance;
        let [own, once, twice] = self.filtered;
        let lost = [0, 1].map(|axis| COUPLING * self.current[axis] + once[axis]);
        let slope = [0, 1].map(|axis| (COUPLING * own[axis] + twice[axis]) / beta);
        let rest = [0, 1].map(|axis| self.turns * self.current[axis] - lost[axis] + beta * slope[axis]);
        let phase = self.shorted.phase;
        let torque_per_current = self.k * phase_shapes(sin_cos_e)[phase];
        let torque = |phasor| torque_per_current * abc_from_alpha_beta(alpha_beta_from_dq(phasor, sin_cos_e))[phase];
        [-torque(slope), torque(rest)]
    }
}

/// Product of two complex numbers.
fn times([a, b]: Phasor, [c, d]: Phasor) -> Phasor {
    [a * c - b * d, a * d + b * c]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::relations::balance_shape::BalanceShape;
    use crate::relations::measured::MeasuredWindow;
    use crate::relations::sample_reading::SampleReader;
    use ema_models::{Real, SensedSample, Setpoint};
    use std::vec::Vec;

    /// Motor angle, rad, and currents i_d, i_q, A, at a time: the speed rises to 150 rad/s and falls.
    fn motion(t: f64) -> (f64, Phasor) {
        let omega = 40.0;
        let angle = 150.0 / omega * (1.0 - libm::cos(omega * t));
        (angle, [0.5 * libm::sin(30.0 * t), 6.0 * libm::sin(60.0 * t)])
    }

    fn phase_current(params: &ActuatorParams, t: f64, phase: usize) -> (f64, f64) {
        let (angle, dq) = motion(t);
        let sin_cos = (params.motor.pole_pairs * angle).sin_cos_poly();
        (
            abc_from_alpha_beta(alpha_beta_from_dq(dq, sin_cos))[phase],
            phase_shapes(sin_cos)[phase],
        )
    }

    /// Torque of the phase by the loop's own equation, every microsecond: `k s_j (N i_j + σ i_f)`.
    fn torque_by_loop(params: &ActuatorParams, phase: usize, share: f64, bridge: f64, samples: usize) -> Vec<f64> {
        let motor = &params.motor;
        let (step, mut i_f) = (1e-6, 0.0);
        let coupling = (COUPLING - share) / (1.0 - share);
        let mut torques = Vec::new();
        for n in 0..samples * per_sample(params) {
            let t = n as f64 * step;
            let (current, shape) = phase_current(params, t, phase);
            torques.push(motor.k * shape * ((1.0 - share) * current + share * i_f));
            let (later, _) = phase_current(params, t + step, phase);
            let emf = motor.k * shape * (motion(t + step).0 - motion(t).0) / step;
            let mutual = coupling * (1.0 - share) * share * motor.l_s * (later - current) / step;
            // Backward Euler in i_f.
            let own = share * share * motor.l_s / step;
            i_f = (own * i_f + bridge * current - mutual - share * emf) / (own + share * motor.r_s + bridge);
        }
        torques
    }

    /// Microseconds from sample to sample.
    fn per_sample(params: &ActuatorParams) -> usize {
        (1e6 / params.sensors.sample_rate) as usize
    }

    /// A torque at the samples from the third one, or its means around them by the triangle to both neighbours.
    fn at_samples(params: &ActuatorParams, torques: &[f64]) -> Vec<f64> {
        let every = per_sample(params);
        let reach = if instants(params) > 0 { every } else { 1 };
        let mean = |n: usize| {
            let around = (n * every + 1 - reach)..(n * every + reach);
            let weight = |m: usize| 1.0 - (m as f64 - (n * every) as f64).abs() / reach as f64;
            around.map(|m| weight(m) * torques[m]).sum::<f64>() / reach as f64
        };
        (2..torques.len() / every - 2).map(mean).collect()
    }

    fn samples(params: &ActuatorParams, count: usize) -> Vec<SensedSample> {
        let sample = |n: usize| {
            let t = n as f64 / params.sensors.sample_rate;
            SensedSample {
                seq: n as u64,
                currents: [0, 1, 2].map(|phase| phase_current(params, t, phase).0),
                motor_counts: libm::floor(motion(t).0 / params.sensors.motor_lsb()) as i64,
                output_counts: 0,
                setpoint: Setpoint::Position(0.0),
            }
        };
        (0..count).map(sample).collect()
    }

    /// The term of the admittance and the rest, by sample from the third one.
    fn by_samples(params: &ActuatorParams, samples: &[SensedSample], shorted: ShortedLoop) -> Vec<[f64; 2]> {
        let window = MeasuredWindow::new(params, samples, &[]);
        let mut torque = LoopTorque::new(shorted, 1.0, &params.motor, params);
        let mut reader = SampleReader::new(&window, &BalanceShape::usual(params), 1.0);
        window.inner().map(|n| torque.next(&reader.next(n))).collect()
    }

    fn rms(values: impl Iterator<Item = f64>) -> f64 {
        let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value * value, count + 1.0));
        libm::sqrt(sum / count)
    }

    #[test]
    fn the_torque_is_that_of_the_equation_of_the_loop() {
        let mut params = ActuatorParams::bench();
        // At 2 kHz torques at the samples, at 800 Hz means around them.
        for (rate, within) in [(2000.0, 0.03), (800.0, 0.06)] {
            params.sensors.sample_rate = rate;
            let recorded = samples(&params, (0.15 * rate) as usize);
            for (phase, share, bridge) in [(0, 0.15, 1.0), (1, 0.4, 0.0), (2, 0.3, 0.4)] {
                let admittance = share * share / (share * params.motor.r_s + bridge);
                let found = by_samples(&params, &recorded, ShortedLoop { phase, admittance });
                let expected = at_samples(&params, &torque_by_loop(&params, phase, share, bridge, recorded.len()));
                let without = at_samples(&params, &torque_by_loop(&params, phase, 1e-6, 1.0, recorded.len()));
                let errors = found
                    .iter()
                    .zip(&expected)
                    .map(|([term, rest], expected)| rest + admittance * term - expected);
                let lost = rms(without
                    .iter()
                    .zip(&expected)
                    .map(|(without, expected)| without - expected));
                let error = rms(errors);
                assert!(error < within * lost, "{rate} Hz, phase {phase}: {error} Nm of {lost}");
            }
        }
    }

    #[test]
    fn the_term_is_the_derivative_with_respect_to_the_admittance() {
        let params = ActuatorParams::bench();
        let recorded = samples(&params, 300);
        let torques = |admittance| by_samples(&params, &recorded, ShortedLoop { phase: 1, admittance });
        let (admittance, step) = (0.08, 1e-4);
        let whole = |rows: Vec<[f64; 2]>, admittance: f64| -> Vec<f64> {
            rows.into_iter().map(|[term, rest]| rest + admittance * term).collect()
        };
        let (at, above) = (
            whole(torques(admittance), admittance),
            whole(torques(admittance + step), admittance + step),
        );
        let terms = torques(admittance);
        let errors = terms
            .iter()
            .zip(at.iter().zip(&above))
            .map(|([term, _], (at, above))| term - (above - at) / step);
        assert!(rms(errors) < 0.03 * rms(terms.iter().map(|[term, _]| *term)));
    }

    #[test]
    fn the_share_of_an_admittance_is_the_mean_over_all_shorts_that_have_it() {
        // Shorts on a grid: share and bridge resistance uniform, those of nearly this admittance.
        let r = 2.75;
        for b in [0.03, 0.1, 0.4] {
            let (mut sum, mut shares, mut squares) = (0.0, 0.0, 0.0);
            for m in 0..1000 {
                for n in 0..1000 {
                    let share = (f64::from(m) + 0.5) * 1e-3;
                    let rho = MAX_BRIDGE * (f64::from(n) + 0.5) * 1e-3;
                    if (share * share / (share + rho) / b - 1.0).abs() < 0.02 {
                        (sum, shares, squares) = (sum + 1.0, shares + share, squares + share * share);
                    }
                }
            }
            let (mean, deviation) = (shares / sum, libm::sqrt(squares / sum - shares * shares / sum / sum));
            let found = ShortedShare::of(b / r, r);
            assert!((found.mean / mean - 1.0).abs() < 0.02, "{found:?} instead of {mean}");
            assert!(
                (found.deviation / deviation - 1.0).abs() < 0.05,
                "{found:?} instead of {deviation}"
            );
            let slope = (ShortedShare::of((b + 1e-4) / r, r).mean - found.mean) / 1e-4 * r;
            assert!((found.slope / slope - 1.0).abs() < 0.3, "{found:?}, slope {slope}");
        }
        assert!((ShortedShare::of(5.0, r).mean - 1.0).abs() < 1e-12);
    }
}

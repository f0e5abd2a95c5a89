//! A window as the relations read it: measured quantities of each sample in SI units.

use core::f64::consts::TAU;
use core::ops::Range;

use ema_models::{ActuatorParams, MotorParams, Real, SensedSample, Setpoint, number_of_counts, temperature_factors};

use super::gear_loss::GearLossSigma;
#[cfg(feature = "std")]
use super::noise_change::NoiseChange;
use crate::recorded_sample::RecordedSample;

/// A window of consecutive samples, its counters on one wrap.
#[derive(Debug)]
pub struct MeasuredWindow<'a, S> {
    params: &'a ActuatorParams,
    /// Its motor, as warm as it is in this window.
    motor: MotorParams,
    samples: &'a [S],
    filled: &'a [usize],
    since: SinceCommissioning,
    /// Its noise and that of commissioning, where both count.
    #[cfg(feature = "std")]
    noise: Option<NoiseChange>,
}

impl<S> Clone for MeasuredWindow<'_, S> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<S> Copy for MeasuredWindow<'_, S> {}

/// Winding temperature of a window of a commissioned unit, °C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindingTemp {
    /// In the window.
    pub now: f64,
    /// In the middle of those at which the unit was commissioned, whose torque for each ampere is that of the type.
    pub commissioned: f64,
}

impl WindingTemp {
    /// Torque for each ampere in the window as a share of that at commissioning, 1: the magnets are as warm as the winding.
    #[must_use]
    pub fn torque_factor(&self) -> f64 {
        let [[_, now], [_, commissioned]] = [self.now, self.commissioned].map(temperature_factors);
        now / commissioned
    }
}

/// What is other in a window than it was when its unit was commissioned; by default nothing that is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SinceCommissioning {
    /// How warm the winding is, where that is measured; else as the type says.
    pub winding_temp: Option<WindingTemp>,
    /// The unit moved otherwise then.
    pub is_other_motion: bool,
    /// It was sampled at another rate then.
    pub is_other_rate: bool,
    /// Load torque at the output, Nm, where it is measured.
    pub measured_load: Option<f64>,
    /// How well it is known what the gear loses under a load.
    pub gear_loss_sigma: GearLossSigma,
}

/// Measured quantities of one sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quantities {
    /// Phase currents, A.
    pub(super) i: [f64; 3],
    /// Their derivatives, A/s: central differences.
    pub(super) di: [f64; 3],
    /// Motor angle since the first sample, rad.
    pub(super) theta_m: f64,
    /// Motor angle within its turn, rad.
    pub(super) angle_in_turn: f64,
    /// Motor speed, rad/s: mean of three central differences of the angle.
    pub(super) omega_m: f64,
    /// Output angle since the first sample, rad.
    pub(super) travel: f64,
    /// Change of the speed reference that the last two set points made, mean of both, rad/s.
    pub(super) reference_step: f64,
    /// Magnitude of the speed reference at the nominal gain, as a share of ω_max, before the limit; 0 in speed mode.
    pub(super) speed_reference: f64,
    /// Whether a position is commanded.
    pub(super) is_position: bool,
    /// Sine and cosine of the electrical angle.
    pub(super) sin_cos_e: (f64, f64),
}

/// Angle and currents at one instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instant {
    /// Motor angle within its turn, rad; beyond it by what the motor turns in one interval.
    pub(super) angle_in_turn: f64,
    /// Sine and cosine of the electrical angle.
    pub(super) sin_cos_e: (f64, f64),
    /// Phase currents, A.
    pub(super) i: [f64; 3],
}

impl Quantities {
    /// The instant of the sample.
    pub(super) fn instant(&self) -> Instant {
        Instant {
            angle_in_turn: self.angle_in_turn,
            sin_cos_e: self.sin_cos_e,
            i: self.i,
        }
    }
}

/// Largest current, as a share of `I_max`.
const CURRENT_SHARE: f64 = 0.9;

/// Smallest speed under the kernel, rad/s: below, friction is no function of the measured speed.
pub(super) const MOVING: f64 = 3.0;

/// Samples that [`MeasuredWindow::quantities`] needs on either side.
pub(super) const MARGIN: usize = 2;

impl<'a, S: RecordedSample> MeasuredWindow<'a, S> {
    /// A window of an actuator's samples; those of the ascending indices `filled` were not measured, and no kernel reaches
    /// over them.
    #[must_use]
    pub fn new(params: &'a ActuatorParams, samples: &'a [S], filled: &'a [usize]) -> Self {
        Self {
            params,
            motor: params.motor,
            samples,
            filled,
            since: SinceCommissioning::default(),
            #[cfg(feature = "std")]
            noise: None,
        }
    }

    /// The same with this being other than at commissioning.
    #[must_use]
    pub fn with(self, since: SinceCommissioning) -> Self {
        let motor = &self.params.motor;
        let warm = |temp: WindingTemp| MotorParams {
            k: motor.k * temp.torque_factor(),
            r_s: motor.at_temperature(temp.now).r_s,
            ..*motor
        };
        Self {
            motor: since.winding_temp.map_or(*motor, warm),
            since,
            ..self
        }
    }

    /// The same with its residuals counted beyond what its noise explains.
    #[cfg(feature = "std")]
    #[must_use]
    pub fn with_noise(self, noise: Option<NoiseChange>) -> Self {
        Self { noise, ..self }
    }

    /// Its noise and that of commissioning, where both count.
    #[cfg(feature = "std")]
    pub(super) fn noise(&self) -> Option<&NoiseChange> {
        self.noise.as_ref()
    }

    pub(super) fn is_other_motion(&self) -> bool {
        self.since.is_other_motion
    }

    pub(super) fn is_other_rate(&self) -> bool {
        self.since.is_other_rate
    }

    /// What is other than at commissioning.
    pub(super) fn since(&self) -> &SinceCommissioning {
        &self.since
    }

    /// The motor as warm as it is.
    pub(super) fn motor(&self) -> &MotorParams {
        &self.motor
    }

    /// The actuator's type.
    #[must_use]
    pub fn params(&self) -> &'a ActuatorParams {
        self.params
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Indices of the samples that have [`MARGIN`] neighbours.
    pub(super) fn inner(&self) -> Range<usize> {
        MARGIN..self.len().saturating_sub(MARGIN).max(MARGIN)
    }

    /// The sample of a place.
    pub(super) fn sensed(&self, n: usize) -> SensedSample {
        self.samples[n].sensed(n as u64)
    }

    /// Whether a sample and the neighbours from which its derivatives come were measured.
    pub(super) fn is_measured(&self, n: usize) -> bool {
        let near = self.filled.partition_point(|&filled| filled + MARGIN < n);
        self.filled.get(near).is_none_or(|&filled| filled > n + MARGIN)
    }

    /// Quantities of a sample of [`MeasuredWindow::inner`].
    pub(super) fn quantities(&self, n: usize) -> Quantities {
        let sensors = &self.params.sensors;
        let (motor_lsb, rate) = (sensors.motor_lsb(), sensors.sample_rate);
        let motor_counts = |n: usize| self.sensed(n).motor_counts;
        let (before, after) = (self.sensed(n - 1).currents, self.sensed(n + 1).currents);
        let turned = motor_counts(n + 1) + motor_counts(n + 2) - motor_counts(n - 1) - motor_counts(n - 2);
        let Instant {
            angle_in_turn,
            sin_cos_e,
            i,
        } = self.instant(n);
        Quantities {
            i,
            di: core::array::from_fn(|j| 0.5 * (after[j] - before[j]) * rate),
            theta_m: number_of_counts(motor_counts(n) - motor_counts(0)) * motor_lsb,
            angle_in_turn,
            omega_m: number_of_counts(turned) * motor_lsb * rate / 6.0,
            travel: self.travelled(n),
            reference_step: self.mean_reference_step(n),
            speed_reference: self.speed_reference(n),
            is_position: matches!(self.sensed(n).setpoint, Setpoint::Position(_)),
            sin_cos_e,
        }
    }

    /// Change of the speed reference that the last two set points made, mean of both, rad/s.
    pub(super) fn mean_reference_step(&self, n: usize) -> f64 {
        let setpoint = |n: usize| self.sensed(n).setpoint;
        let [two_before, before, now] = [setpoint(n - 2), setpoint(n - 1), setpoint(n)];
        0.5 * (self.reference_step(two_before, before) + self.reference_step(before, now))
    }

    /// Angle and currents of a sample.
    pub(super) fn instant(&self, n: usize) -> Instant {
        let (now, sensors) = (self.sensed(n), &self.params.sensors);
        let in_turn = remainder(now.motor_counts, sensors.motor_counts_per_rev as i64);
        let angle_in_turn = (number_of_counts(in_turn) + 0.5) * TAU / sensors.motor_counts_per_rev;
        Instant {
            angle_in_turn,
            sin_cos_e: (self.params.motor.pole_pairs * angle_in_turn).sin_cos_poly(),
            i: now.currents,
        }
    }

    /// Change of the speed reference that takes effect behind sample `n`, rad/s, where the reference is not limited; the gain factor is
    /// `gain`. Of the first sample none is known.
    pub(super) fn reference_change(&self, n: usize, gain: f64) -> f64 {
        if n == 0 || self.speed_reference(n) * gain >= 1.0 {
            return 0.0;
        }
        gain * self.reference_step(self.sensed(n - 1).setpoint, self.sensed(n).setpoint)
    }

    /// Change of the speed reference from one set point to the next, rad/s, before any limit.
    fn reference_step(&self, from: Setpoint, to: Setpoint) -> f64 {
        match (from, to) {
            (Setpoint::Position(from), Setpoint::Position(to)) => self.params.controller.g_p * (to - from),
            (Setpoint::Speed(from), Setpoint::Speed(to)) => to - from,
            _ => 0.0,
        }
    }

    /// Whether a quadrature current, A, may be at the controller's limit.
    pub(super) fn is_current_limited(&self, quadrature: f64) -> bool {
        libm::fabs(quadrature) >= CURRENT_SHARE * self.params.motor.i_max
    }

    /// Magnitude of the position loop's speed reference at the nominal gain, as a share of ω_max, before the limit.
    pub(super) fn speed_reference(&self, n: usize) -> f64 {
        let controller = &self.params.controller;
        let reference = self.position_error(n).map_or(0.0, |error| controller.g_p * error);
        libm::fabs(reference) / controller.omega_max
    }

    /// Motor speed at a sample of [`MeasuredWindow::inner`], rad/s: central difference of the angle.
    pub(super) fn central_speed(&self, n: usize) -> f64 {
        let sensors = &self.params.sensors;
        let turned = self.sensed(n + 1).motor_counts - self.sensed(n - 1).motor_counts;
        0.5 * number_of_counts(turned) * sensors.motor_lsb() * sensors.sample_rate
    }

    /// Output angle since the first sample, rad.
    pub(super) fn travelled(&self, n: usize) -> f64 {
        number_of_counts(self.sensed(n).output_counts - self.sensed(0).output_counts) * self.params.sensors.output_lsb()
    }

    /// Output angle less the motor angle at the output, both since the first sample, rad.
    pub(super) fn behind_gear(&self, n: usize) -> f64 {
        let (sensors, gear_ratio) = (&self.params.sensors, self.params.transmission.gear_ratio);
        let (first, now) = (self.sensed(0), self.sensed(n));
        number_of_counts(now.output_counts - first.output_counts) * sensors.output_lsb()
            - number_of_counts(now.motor_counts - first.motor_counts) * sensors.motor_lsb() / gear_ratio
    }

    /// Smallest and largest output angle since the first sample, rad.
    pub(super) fn travel(&self) -> Range<f64> {
        let lsb = self.params.sensors.output_lsb();
        let first = if self.is_empty() {
            0
        } else {
            self.sensed(0).output_counts
        };
        (0..self.len()).fold(0.0..0.0, |range, n| {
            let travel = number_of_counts(self.sensed(n).output_counts - first) * lsb;
            range.start.min(travel)..range.end.max(travel)
        })
    }

    /// Control deviation `θ_cmd − θ_out` as the controller counts it, rad; `None` outside position mode.
    pub(super) fn position_error(&self, n: usize) -> Option<f64> {
        let output = number_of_counts(self.sensed(n).output_counts) * self.params.sensors.output_lsb();
        Some(self.commanded_angle(n)? - output)
    }

    /// Set point θ_cmd, rad; `None` outside position mode.
    pub(super) fn commanded_angle(&self, n: usize) -> Option<f64> {
        match self.sensed(n).setpoint {
            Setpoint::Position(angle) => Some(angle),
            Setpoint::Idle | Setpoint::Speed(_) => None,
        }
    }
}

/// Counts within one turn: a controller has an instruction for 32 bits only.
fn remainder(counts: i64, per_turn: i64) -> i64 {
    match (i32::try_from(counts), i32::try_from(per_turn)) {
        (Ok(counts), Ok(per_turn)) => i64::from(counts.rem_euclid(per_turn)),
        _ => counts.rem_euclid(per_turn),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filled_sample_spoils_its_neighbours() {
        let params = ActuatorParams::bench();
        let sample = SensedSample {
            seq: 0,
            currents: [0.0; 3],
            motor_counts: 0,
            output_counts: 0,
            setpoint: Setpoint::Idle,
        };
        let samples = [sample; 20];
        let window = MeasuredWindow::new(&params, &samples, &[5, 12]);
        let spoilt = [3, 4, 5, 6, 7, 10, 11, 12, 13, 14];
        for n in window.inner() {
            assert_eq!(window.is_measured(n), !spoilt.contains(&n), "{n}");
        }
        assert!(MeasuredWindow::new(&params, &samples[..3], &[]).inner().is_empty());
    }
}

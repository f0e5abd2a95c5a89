//! One actuation as the controller recorded it: raw sensor words, 24 bytes a sample.

use ema_models::{
    ActuatorParams, AngleReading, ComparedSample, Encoder, InitialState, OutputAngleEstimator, SensedSample, Setpoint,
    Signals, WindowFrame, output_angle_between,
};
use ema_wire::{Mode, Sample, quantity};

/// Control periods per sample at most: 400 Hz at 100 µs.
pub const MAX_CONTROLS: usize = 25;

/// A window of consecutive samples, none missing, its counters on one wrap; read through, never copied.
#[derive(Clone, Copy, Debug)]
pub struct RecordedWindow<'a> {
    samples: &'a [Sample],
    frame: WindowFrame,
    output: OutputAngleEstimator,
    encoder: Encoder<f32>,
    controls: usize,
    initial: InitialState,
}

/// What all monitors of a window take from one sample.
#[derive(Clone, Copy, Debug)]
pub struct Drive {
    /// What the sensors said.
    pub measured: Signals<f32>,
    /// The setpoint latched with it.
    pub setpoint: Setpoint<f32>,
    /// Output angle as counted at each control period, rad; as many as [`RecordedWindow::controls`].
    pub counted: [f32; MAX_CONTROLS],
    /// Motor angle at the sample's end, rad.
    pub theta_m: f32,
}

impl<'a> RecordedWindow<'a> {
    /// A window whose first `rest` samples precede the trigger; `None` of an empty one, or of one sampled less often than
    /// every [`MAX_CONTROLS`] control periods.
    #[must_use]
    pub fn new(params: &ActuatorParams, samples: &'a [Sample], rest: usize) -> Option<Self> {
        let controls = libm::round(1.0 / (params.sensors.sample_rate * params.controller.period)) as usize;
        let rest = rest.clamp(1, samples.len().max(1));
        let (first, last_at_rest) = (samples.first()?, samples.get(rest - 1)?);
        let frame = WindowFrame::new(params, &sensed(0, first));
        let output = OutputAngleEstimator::new(params, &frame.origin(), || {
            samples.iter().map(|sample| reading(&frame, sample))
        });
        let at_rest = (0..rest).map(|n| compared(&frame, samples, n));
        let initial = frame.initial_state(&sensed(rest - 1, last_at_rest), at_rest.map(|s| [s.i_d, s.i_q]));
        (controls <= MAX_CONTROLS).then_some(Self {
            samples,
            frame,
            output,
            encoder: Encoder::new(params.sensors.output_lsb()),
            controls,
            initial,
        })
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Never true.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Control periods per sample.
    #[must_use]
    pub fn controls(&self) -> usize {
        self.controls
    }

    /// State at the first sample.
    #[must_use]
    pub fn initial(&self) -> &InitialState {
        &self.initial
    }

    /// The samples in the monitor's terms.
    pub fn compared(&self) -> impl Iterator<Item = ComparedSample> {
        let mut output = self.output;
        (0..self.samples.len()).map(move |n| {
            let mut sample = compared(&self.frame, self.samples, n);
            sample.theta_out_estimate = output.next_angle(AngleReading::from(&sample));
            sample
        })
    }

    /// What the monitors take from each sample.
    pub fn drives(&self) -> impl Iterator<Item = Drive> {
        let mut ahead = self.compared();
        let mut next = ahead.next();
        core::iter::from_fn(move || {
            let now = next?;
            next = ahead.next();
            // The last sample holds.
            let after = next.unwrap_or(now);
            let mut counted = [0.0; MAX_CONTROLS];
            for (control, slot) in (0..).zip(&mut counted[..self.controls]) {
                let read = output_angle_between(&now, &after, control, self.controls as u32);
                *slot = self.encoder.counted_angle(read as f32);
            }
            Some(Drive {
                measured: Signals::from_sample(&now).map(|x| x as f32),
                setpoint: now.setpoint.map(|x| x as f32),
                counted,
                theta_m: after.theta_m as f32,
            })
        })
    }
}

/// The sample of a place between its neighbours.
fn compared(frame: &WindowFrame, samples: &[Sample], n: usize) -> ComparedSample {
    let at = |n: usize| sensed(n, &samples[n]);
    frame.compared(&at(n.saturating_sub(1)), &at(n), &at((n + 1).min(samples.len() - 1)))
}

fn reading(frame: &WindowFrame, sample: &Sample) -> AngleReading {
    let [theta_m, theta_out] = frame.angles(&sensed(0, sample));
    AngleReading {
        theta_m,
        theta_out,
        measured: true,
    }
}

/// A sample in SI units, at its place in the window.
fn sensed(n: usize, sample: &Sample) -> SensedSample {
    SensedSample {
        seq: n as u64,
        currents: sample.currents_a(),
        motor_counts: i64::from(sample.motor_counts),
        output_counts: i64::from(sample.output_counts),
        setpoint: match sample.mode {
            Mode::Idle => Setpoint::Idle,
            Mode::Position => Setpoint::Position(quantity::position_setpoint_rad(sample.setpoint)),
            Mode::Speed => Setpoint::Speed(quantity::speed_setpoint_rad_s(sample.setpoint)),
        },
    }
}

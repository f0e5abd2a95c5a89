//! One window as the controller recorded it: raw sensor words, turned into the monitor's terms sample by sample, each time
//! that a monitor runs over them. Nothing is copied.

use ema_models::{
    ActuatorParams, AngleReading, ComparedSample, Encoder, InitialState, OutputAngleEstimator, Real, Setpoint, Signals,
    WindowFrame, output_angle_between,
};

use crate::recorded_sample::RecordedSample;

/// Control periods per sample at most: 400 Hz at 100 µs.
pub const MAX_CONTROLS: usize = 25;

/// A window of consecutive samples, none missing, its counters on one wrap.
#[derive(Clone, Copy, Debug)]
pub struct RecordedWindow<'a, S> {
    samples: &'a [S],
    frame: WindowFrame,
    output: OutputAngleEstimator,
    output_lsb: f64,
    controls: usize,
    initial: InitialState,
}

/// What all monitors of a window take from one sample.
#[derive(Clone, Copy, Debug)]
pub struct SampleDrive<R> {
    /// Sensor readings.
    pub measured: Signals<R>,
    /// The setpoint latched with it.
    pub setpoint: Setpoint<R>,
    /// Output angle as counted at each control period, rad; as many as [`RecordedWindow::controls`].
    pub counted: [R; MAX_CONTROLS],
    /// Motor angle at the sample's end, rad.
    pub theta_m: R,
}

impl<'a, S: RecordedSample> RecordedWindow<'a, S> {
    /// A window whose first `rest` samples precede the trigger; `None` of an empty one, or of one sampled less often than
    /// every [`MAX_CONTROLS`] control periods.
    #[must_use]
    pub fn new(params: &ActuatorParams, samples: &'a [S], rest: usize) -> Option<Self> {
        let controls = libm::round(1.0 / (params.sensors.sample_rate * params.controller.period)) as usize;
        let rest = rest.clamp(1, samples.len().max(1));
        let (first, last_at_rest) = (samples.first()?, samples.get(rest - 1)?);
        let frame = WindowFrame::new(params, &first.sensed(0));
        let output = OutputAngleEstimator::new(params, &frame.origin(), || {
            samples.iter().map(|sample| reading(&frame, sample))
        });
        let at_rest = (0..rest).map(|n| compared(&frame, samples, n));
        let last_at_rest = last_at_rest.sensed(rest as u64 - 1);
        let initial = frame.initial_state(&last_at_rest, at_rest.map(|s| [s.i_d, s.i_q]), output.backlash());
        (controls <= MAX_CONTROLS).then_some(Self {
            samples,
            frame,
            output,
            output_lsb: params.sensors.output_lsb(),
            controls,
            initial,
        })
    }

    /// The samples as they were recorded.
    pub(crate) fn samples(&self) -> &'a [S] {
        self.samples
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

    /// Shows what monitors in numbers of type `R` take from each sample. Nothing is moved: a controller copies slowly.
    pub fn for_each_drive<R: Real>(&self, mut visit: impl FnMut(&SampleDrive<R>)) {
        let encoder = Encoder::<R>::new(self.output_lsb);
        let mut ahead = self.compared();
        let Some(mut now) = ahead.next() else {
            return;
        };
        let mut drive = SampleDrive {
            measured: Signals::from_sample(&now).map(R::splat),
            setpoint: now.setpoint.map(R::splat),
            counted: [R::zero(); MAX_CONTROLS],
            theta_m: R::splat(now.theta_m),
        };
        loop {
            let next = ahead.next();
            // The last sample holds.
            let after = next.unwrap_or(now);
            for (control, slot) in (0..).zip(&mut drive.counted[..self.controls]) {
                let read = output_angle_between(&now, &after, control, self.controls as u32);
                *slot = encoder.counted_angle(R::splat(read));
            }
            drive.measured = Signals::from_sample(&now).map(R::splat);
            drive.setpoint = now.setpoint.map(R::splat);
            drive.theta_m = R::splat(after.theta_m);
            visit(&drive);
            now = match next {
                Some(next) => next,
                None => return,
            };
        }
    }
}

/// The sample of a place between its neighbours.
fn compared<S: RecordedSample>(frame: &WindowFrame, samples: &[S], n: usize) -> ComparedSample {
    let sensed = |n: usize| samples[n].sensed(n as u64);
    frame.compared(
        &sensed(n.saturating_sub(1)),
        &sensed(n),
        &sensed((n + 1).min(samples.len() - 1)),
    )
}

fn reading<S: RecordedSample>(frame: &WindowFrame, sample: &S) -> AngleReading {
    let [theta_m, theta_out] = frame.angles(&sample.sensed(0));
    AngleReading {
        theta_m,
        theta_out,
        measured: true,
    }
}

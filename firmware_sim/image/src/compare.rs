//! Monitors against a recorded window: costs and normal equations, summed while the window is read through.

use ema_models::{
    ActuatorParams, Calibration, Conditions, Coordinates, Monitor, MonitorState, NormalEquations, Prior, ResidualState,
    SIGNAL_COUNT, Scale, Signals, UNKNOWN_COUNT, Unknowns, Weights,
};

use crate::window::RecordedWindow;

/// Everything a fault vector is judged by but the window: the actuator's type, the monitor's calibration, the weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Identification {
    /// The actuator, as known.
    pub params: ActuatorParams,
    /// The monitor's calibration.
    pub calibration: Calibration,
    /// Load and supply during the window.
    pub conditions: Conditions,
    /// What counts how much.
    pub weights: Weights,
    /// Root-mean-square residual of each signal that the weights expect.
    pub expected: Signals<f64>,
    /// What is known of load, integral and motor beforehand.
    pub prior: Prior,
}

/// One monitor at work.
#[derive(Clone, Copy)]
struct Running {
    monitor: Monitor<f32>,
    state: MonitorState<f32>,
    residual: ResidualState<f32>,
}

/// Monitors of one linearisation: the point and one step along each coordinate.
const POINT_AND_STEPS: usize = UNKNOWN_COUNT + 1;

impl Identification {
    /// The monitor for one set of unknowns; it is made in double precision and then runs in single.
    #[must_use]
    pub fn monitor(&self, unknowns: &Unknowns) -> Monitor<f32> {
        let unknowns = self.conditions.at_temperature(unknowns);
        Monitor::new(&self.params, &self.calibration, self.conditions.v_dc, &unknowns).map(|x| x as f32)
    }

    /// Runs monitors in lock-step over a window and shows their unweighted residuals, sample by sample.
    ///
    /// What all of them take from a sample is made ready once for all.
    fn run<const N: usize>(
        &self,
        window: &RecordedWindow<'_>,
        unknowns: impl Fn(usize) -> Unknowns,
        mut visit: impl FnMut(&[[f32; SIGNAL_COUNT]; N]),
    ) {
        let initial = window.initial();
        let Some(first) = window.compared().next() else { return };
        let start = |n| {
            let monitor = self.monitor(&unknowns(n));
            Running {
                state: monitor.start(initial, &first),
                monitor,
                residual: ResidualState::new(self.params.sensors.sample_rate),
            }
        };
        // Not `from_fn`, which makes the array twice, one on top of the other on the stack.
        let mut running = [start(0); N];
        for (n, one) in running.iter_mut().enumerate().skip(1) {
            *one = start(n);
        }
        for (n, drive) in window.drives().enumerate() {
            let mut residuals = [[0.0; SIGNAL_COUNT]; N];
            for (one, residuals) in running.iter_mut().zip(&mut residuals) {
                let earlier = n >= one.residual.span();
                let output = one.monitor.output(&one.state);
                *residuals = one.residual.next(&drive.measured, &output, earlier).to_array();
                let counted = &drive.counted[..window.controls()];
                one.monitor
                    .run_sample_period_with(&mut one.state, initial, drive.setpoint, counted, drive.theta_m);
            }
            visit(&residuals);
        }
    }

    /// Cost `½ Σ r²` of one point, what is known beforehand included.
    #[must_use]
    pub fn cost(&self, window: &RecordedWindow<'_>, at: &Coordinates) -> f64 {
        let scale = Scale::new(&self.params);
        let weights = self.weights.to_array().map(|w| w as f32);
        let mut cost = 0.0;
        self.run::<1>(
            window,
            |_| scale.unknowns(at),
            |[residuals]| cost += half_square(&weights, residuals),
        );
        cost + self.prior.cost(&scale, &self.conditions, at)
    }

    /// Normal equations at a point, by forward differences of length `step` towards the inside of the box.
    ///
    /// The slopes are summed in single precision: they only say where to look next. The cost, which decides, is not.
    #[must_use]
    pub fn normal_equations(&self, window: &RecordedWindow<'_>, at: &Coordinates, step: f64) -> NormalEquations {
        let scale = Scale::new(&self.params);
        let steps = at.inward_steps(step);
        let per_step = steps.map(|step| (1.0 / step) as f32);
        let weights = self.weights.to_array().map(|w| w as f32);
        let mut cost = 0.0;
        let mut jtr = [0.0f32; UNKNOWN_COUNT];
        let mut jtj = [[0.0f32; UNKNOWN_COUNT]; UNKNOWN_COUNT];
        let stepped = |n: usize| {
            let mut x = *at;
            if let Some(p) = n.checked_sub(1) {
                x.0[p] += steps[p];
            }
            scale.unknowns(&x)
        };
        self.run::<POINT_AND_STEPS>(window, stepped, |residuals| {
            let [point, along @ ..] = residuals;
            cost += half_square(&weights, point);
            for signal in 0..SIGNAL_COUNT {
                let r = point[signal];
                let weight = weights[signal];
                let slope: [f32; UNKNOWN_COUNT] =
                    core::array::from_fn(|p| weight * ((along[p][signal] - r) * per_step[p]));
                for p in 0..UNKNOWN_COUNT {
                    jtr[p] += slope[p] * (weight * r);
                    for q in 0..=p {
                        jtj[p][q] += slope[p] * slope[q];
                    }
                }
            }
        });
        let mut sums = NormalEquations {
            jtj: core::array::from_fn(|p| core::array::from_fn(|q| f64::from(jtj[p.max(q)][p.min(q)]))),
            jtr: jtr.map(f64::from),
            cost,
        };
        self.prior.add_to(&mut sums, &scale, &self.conditions, at);
        sums
    }

    /// Root-mean-square residual of each signal at a point.
    pub(crate) fn residual_rms(&self, window: &RecordedWindow<'_>, at: &Coordinates) -> [f64; SIGNAL_COUNT] {
        let scale = Scale::new(&self.params);
        let mut squares = [0.0; SIGNAL_COUNT];
        self.run::<1>(
            window,
            |_| scale.unknowns(at),
            |[residuals]| {
                for (sum, &r) in squares.iter_mut().zip(residuals) {
                    *sum += f64::from(r * r);
                }
            },
        );
        squares.map(|sum| libm::sqrt(sum / window.len() as f64))
    }
}

/// `½ Σ (w r)²` over the signals of one sample.
fn half_square(weights: &[f32; SIGNAL_COUNT], residuals: &[f32; SIGNAL_COUNT]) -> f64 {
    let mut sum = 0.0;
    for (weight, r) in weights.iter().zip(residuals) {
        let weighted = weight * r;
        sum += f64::from(weighted * weighted);
    }
    0.5 * sum
}

//! Both sides of each relation over one window, to be drawn: what was measured against what the commissioned unit explains it by.

use std::vec::Vec;

use ema_models::follow_through_play;

use super::commissioned::{CommissionedRelations, RelationsEstimate};
use super::compliance::Compliance;
use super::controller::{Law, LawRows};
use super::elements::Element;
use super::kernel::{HALF_WIDTHS_S, Kernel};
use super::measured::{MARGIN, MeasuredWindow};
use super::output_load::OutputLoad;
use super::residual::Relation;
use super::shared::place_of;
use super::sliding::Sliding;
use super::terms::{BalanceRing, TERM_COUNT, Term, WindowState, balance_rows};
use super::transmission::pushed;
use crate::recorded_sample::RecordedSample;

/// Both sides of a relation at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint {
    /// Time since the window's first sample, s.
    pub time_s: f64,
    /// Measured and modelled side; `None` where the relation does not hold: at rest, at a limit, over missing samples.
    pub sides: Option<[f64; 2]>,
}

/// A relation over one window.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// The relation, which gives the unit: torque at the motor, Nm; its derivative, Nm/s; output angle less motor angle at the
    /// output, rad.
    pub relation: Relation,
    /// In ascending order of time.
    pub points: Vec<CurvePoint>,
}

impl Curve {
    /// Root-mean-square of measured less modelled; `None` without a point.
    #[must_use]
    pub fn residual_rms(&self) -> Option<f64> {
        let shown: Vec<f64> = self
            .points
            .iter()
            .filter_map(|point| point.sides)
            .map(|[measured, modelled]| measured - modelled)
            .collect();
        let squares: f64 = shown.iter().map(|residual| residual * residual).sum();
        (!shown.is_empty()).then(|| libm::sqrt(squares / shown.len() as f64))
    }
}

/// Terms of the torque that the currents make; what opposes it is modelled.
const OF_CURRENTS: [Term; 9] = [
    Term::TurnsA,
    Term::TurnsB,
    Term::TurnsC,
    Term::EccentricityCos,
    Term::EccentricitySin,
    Term::EmfHarmonics,
    Term::OffsetA,
    Term::OffsetB,
    Term::Latency,
];

impl CommissionedRelations {
    /// One standard deviation of a shared coefficient of the torque balance, in its unit; `None` for what each window has of its own.
    #[must_use]
    pub fn sigma_of(&self, term: Term) -> Option<f64> {
        let place = place_of(term)?;
        Some(libm::sqrt(self.covariance[place][place].max(0.0)))
    }

    /// Both sides of each relation over a window of the unit, in the order of [`Relation::ALL`]; `estimate` is that of the window.
    #[must_use]
    pub fn curves<S: RecordedSample>(
        &self,
        window: &MeasuredWindow<'_, S>,
        estimate: &RelationsEstimate,
    ) -> [Curve; Relation::ALL.len()] {
        let points = [
            self.torque_balance_points(window, estimate),
            self.controller_points(window),
            self.play_points(window),
        ];
        let mut points = points.into_iter();
        Relation::ALL.map(|relation| Curve {
            relation,
            points: points.next().unwrap_or_default(),
        })
    }

    /// Torque by the currents against inertia, friction and load, Nm.
    fn torque_balance_points<S: RecordedSample>(
        &self,
        window: &MeasuredWindow<'_, S>,
        estimate: &RelationsEstimate,
    ) -> Vec<CurvePoint> {
        let rate = window.params().sensors.sample_rate;
        let kernel = self.balance.kernel(rate);
        let load = OutputLoad {
            constant: estimate.load_torque,
            spring: estimate.spring_stiffness,
        };
        let mut coefficients = self.balance.values;
        coefficients[Term::Load as usize] = load.constant;
        coefficients[Term::Spring as usize] = load.spring;
        let is_of_currents: [bool; TERM_COUNT] =
            core::array::from_fn(|term| OF_CURRENTS.iter().any(|&of| of as usize == term));
        let mut ring = BalanceRing::new(kernel.span);
        balance_rows(
            window,
            &self.balance.shape,
            WindowState::healthy(load),
            &kernel,
            &mut ring,
        )
        .enumerate()
        .filter(|(n, _)| (n + MARGIN).is_multiple_of(kernel.stride))
        .map(|(n, row)| CurvePoint {
            time_s: centre_s(n, &kernel, rate),
            sides: row.map(|row| {
                let mut sides = [0.0; 2];
                for (term, (value, coefficient)) in row.terms.iter().zip(&coefficients).enumerate() {
                    let torque = value * coefficient;
                    if is_of_currents[term] {
                        sides[0] += torque;
                    } else {
                        sides[1] -= torque;
                    }
                }
                sides
            }),
        })
        .collect()
    }

    /// Derivative of the torque against the law of the speed loop, its factors fitted to the window, Nm/s.
    fn controller_points<S: RecordedSample>(&self, window: &MeasuredWindow<'_, S>) -> Vec<CurvePoint> {
        let rate = window.params().sensors.sample_rate;
        let kernel = Kernel::new(self.gain_half_width_s, rate, &Compliance::RIGID);
        let known = self.law_knowledge(None);
        let mut rows = LawRows::new(window, &kernel, 1, known);
        let mut points = Vec::new();
        if let Some(Law { solution, .. }) = Law::new(&mut rows) {
            rows.each(|row| {
                points.push(CurvePoint {
                    time_s: centre_s(points.len(), &kernel, rate),
                    sides: row.map(|(row, d_torque)| {
                        let modelled = row.iter().zip(&solution.x).map(|(a, x)| a * x).sum();
                        [*d_torque, modelled]
                    }),
                });
            });
        }
        points
    }

    /// Output angle against that behind the unit's play, both less the motor angle at the output and smoothed over the encoder's counts,
    /// rad.
    fn play_points<S: RecordedSample>(&self, window: &MeasuredWindow<'_, S>) -> Vec<CurvePoint> {
        let Some(start) = pushed(window) else {
            return Vec::new();
        };
        let rate = window.params().sensors.sample_rate;
        let half = 0.5 * self.baseline[Element::Backlash as usize].mean;
        let at_start = window.behind_gear(start.sample);
        let motor_angle = |n: usize| {
            let (now, first) = (window.sensed(n), window.sensed(start.sample));
            let sensors = &window.params().sensors;
            (now.motor_counts - first.motor_counts) as f64 * sensors.motor_lsb()
                / window.params().transmission.gear_ratio
        };
        let kernel = Kernel::new(HALF_WIDTHS_S[0], rate, &Compliance::RIGID);
        let mut output = if start.forward { -half } else { half };
        let mut ring = Sliding::<2>::new(kernel.span);
        let mut points: Vec<CurvePoint> = (start.sample..window.inner().end)
            .map(|n| {
                let centre = motor_angle(n);
                output = follow_through_play(output, centre, half);
                if window.is_measured(n) {
                    ring.push([window.behind_gear(n) - at_start, output - centre]);
                } else {
                    ring.clear();
                }
                CurvePoint {
                    time_s: n as f64 / rate - 0.5 * (kernel.span - 1) as f64 / rate,
                    sides: ring.is_full().then(|| ring.sums(&kernel.smooth)),
                }
            })
            .collect();
        // The zeros of both counters need not agree.
        let shown: Vec<f64> = points
            .iter()
            .filter_map(|point| point.sides)
            .map(|[measured, modelled]| measured - modelled)
            .collect();
        let mean = shown.iter().sum::<f64>() / shown.len().max(1) as f64;
        for [measured, _] in points.iter_mut().filter_map(|point| point.sides.as_mut()) {
            *measured -= mean;
        }
        points
    }
}

/// Time of the kernel's centre for the n-th inner sample, at which the kernel ends, s.
fn centre_s(n: usize, kernel: &Kernel, rate: f64) -> f64 {
    (n + MARGIN) as f64 / rate - 0.5 * (kernel.span - 1) as f64 / rate
}

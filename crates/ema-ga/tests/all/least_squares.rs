//! Levenberg-Marquardt on problems with certified or derived solutions.

use ema_ga::{Bounds, LmConfig, LmStop, Residuals, levenberg_marquardt};
use nalgebra::{SMatrix, SVector};

/// NIST StRD "Misra1a": dental research, `y = b1 (1 - exp(-b2 x))`.
struct Misra1a;

const VOLUME: [f64; 14] = [
    10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78,
];
const PRESSURE: [f64; 14] = [
    77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0,
];

impl Residuals<2> for Misra1a {
    fn normal_equations(&self, &[b1, b2]: &[f64; 2], jtj: &mut SMatrix<f64, 2, 2>, jtr: &mut SVector<f64, 2>) -> f64 {
        let mut cost = 0.0;
        for (x, y) in PRESSURE.into_iter().zip(VOLUME) {
            let decay = (-b2 * x).exp();
            let r = b1 * (1.0 - decay) - y;
            let row = SVector::<f64, 2>::new(1.0 - decay, b1 * x * decay);
            *jtj += row * row.transpose();
            *jtr += row * r;
            cost += 0.5 * r * r;
        }
        cost
    }

    fn cost(&self, genes: &[f64; 2]) -> f64 {
        self.normal_equations(genes, &mut SMatrix::zeros(), &mut SVector::zeros())
    }
}

#[test]
fn misra1a_reaches_the_certified_values_from_both_nist_starts() {
    let bounds = Bounds::new([0.0, 0.0], [1000.0, 0.01]).unwrap();
    for start in [[500.0, 0.0001], [250.0, 0.0005]] {
        let found = levenberg_marquardt(&Misra1a, &bounds, start, &LmConfig::default());
        println!("{found:?}");
        assert!((found.genes[0] / 2.389_421_291_8e2 - 1.0).abs() < 1e-6);
        assert!((found.genes[1] / 5.501_564_318_1e-4 - 1.0).abs() < 1e-6);
        assert!((2.0 * found.cost / 1.245_513_889_4e-1 - 1.0).abs() < 1e-9);
        assert!(found.iterations <= 20, "{} iterations", found.iterations);
        assert!(matches!(found.stop, LmStop::Gradient | LmStop::Step | LmStop::Cost));
    }
}

#[test]
fn a_step_within_the_cost_tolerance_ends_the_search() {
    let bounds = Bounds::new([0.0, 0.0], [1000.0, 0.01]).unwrap();
    let whole = levenberg_marquardt(&Misra1a, &bounds, [250.0, 0.0005], &LmConfig::default());
    let any_fall_is_little = LmConfig {
        cost_tolerance: f64::INFINITY,
        ..LmConfig::default()
    };
    let found = levenberg_marquardt(&Misra1a, &bounds, [250.0, 0.0005], &any_fall_is_little);
    // The first accepted step ends the search, without another linearisation.
    assert_eq!((found.stop, found.iterations), (LmStop::Cost, 1));
    assert!(found.evaluations >= 2 && found.cost < Misra1a.cost(&[250.0, 0.0005]) && found.cost > whole.cost);
}

/// The slope is foretold with the wrong sign, so that every step is rejected.
struct WrongSlope;

impl Residuals<1> for WrongSlope {
    fn normal_equations(&self, x: &[f64; 1], jtj: &mut SMatrix<f64, 1, 1>, jtr: &mut SVector<f64, 1>) -> f64 {
        (jtj[(0, 0)], jtr[0]) = (1.0, 0.1);
        self.cost(x)
    }

    fn cost(&self, x: &[f64; 1]) -> f64 {
        2.0 - x[0]
    }
}

#[test]
fn a_rejected_step_of_little_promise_ends_the_search() {
    let bounds = Bounds::new([-1.0], [1.0]).unwrap();
    let ended = |rejected_tolerance| {
        let config = LmConfig {
            rejected_tolerance,
            ..LmConfig::default()
        };
        levenberg_marquardt(&WrongSlope, &bounds, [0.0], &config)
    };
    // A step of 0.1 promises 0.005 of a cost of 2.
    let little = ended(0.003);
    assert_eq!(
        (little.stop, little.iterations, little.evaluations),
        (LmStop::Cost, 1, 2)
    );
    assert_eq!((little.genes, little.information[(0, 0)]), ([0.0], 1.0));
    for more in [0.0, 1e-12] {
        let found = ended(more);
        assert!(found.evaluations > 5 && found.genes == [0.0], "{found:?}");
    }
}

#[test]
fn a_step_of_which_little_is_expected_is_not_tried() {
    let bounds = Bounds::new([0.0, 0.0], [1000.0, 0.01]).unwrap();
    let nothing_is_much = LmConfig {
        expected_tolerance: f64::INFINITY,
        ..LmConfig::default()
    };
    let found = levenberg_marquardt(&Misra1a, &bounds, [250.0, 0.0005], &nothing_is_much);
    assert_eq!((found.stop, found.iterations, found.evaluations), (LmStop::Cost, 1, 1));
    let little_is_little = LmConfig {
        expected_tolerance: 1e-6,
        ..LmConfig::default()
    };
    let found = levenberg_marquardt(&Misra1a, &bounds, [250.0, 0.0005], &little_is_little);
    assert!((2.0 * found.cost / 1.245_513_889_4e-1 - 1.0).abs() < 1e-5, "{found:?}");
}

#[test]
fn a_solution_at_a_bound_satisfies_the_conditions_of_optimality() {
    let bounds = Bounds::new([0.0, 0.0], [200.0, 0.01]).unwrap();
    let found = levenberg_marquardt(&Misra1a, &bounds, [50.0, 0.005], &LmConfig::default());
    let (mut jtj, mut gradient) = (SMatrix::zeros(), SVector::zeros());
    Misra1a.normal_equations(&found.genes, &mut jtj, &mut gradient);
    // b1 is exactly at its bound, and the cost falls towards the outside; b2 is free and its gradient vanishes.
    assert_eq!(found.genes[0].to_bits(), 200f64.to_bits());
    assert!(gradient[0] < -1e-3);
    assert!(gradient[1].abs() < 1e-6 * (jtj[(1, 1)] * 2.0 * found.cost).sqrt());
}

#[test]
fn a_gene_leaves_the_bound_when_the_gradient_points_inwards() {
    let bounds = Bounds::new([0.0, 0.0], [1000.0, 0.01]).unwrap();
    // Both genes start at a bound; the solution is inside.
    let found = levenberg_marquardt(&Misra1a, &bounds, [1000.0, 0.0], &LmConfig::default());
    assert!((2.0 * found.cost / 1.245_513_889_4e-1 - 1.0).abs() < 1e-9, "{found:?}");
}

#[test]
fn budgets_end_the_search_and_the_cost_never_rises() {
    let bounds = Bounds::new([0.0, 0.0], [1000.0, 0.01]).unwrap();
    let start = [500.0, 0.0001];
    let mut last = Misra1a.cost(&start);
    for max_evaluations in 1..8 {
        let config = LmConfig {
            max_evaluations,
            ..LmConfig::default()
        };
        let found = levenberg_marquardt(&Misra1a, &bounds, start, &config);
        assert_eq!(
            (found.evaluations, found.stop),
            (max_evaluations, LmStop::MaxEvaluations)
        );
        assert!(found.cost <= last);
        last = found.cost;
    }
    let found = levenberg_marquardt(
        &Misra1a,
        &bounds,
        start,
        &LmConfig {
            max_iterations: 2,
            ..LmConfig::default()
        },
    );
    assert_eq!((found.iterations, found.stop), (2, LmStop::MaxIterations));
}

/// `r = ln x_0`, which is NaN below zero, where the first steps end; `x_1` has no influence.
struct Logarithm {
    broken_derivative: bool,
}

impl Residuals<2> for Logarithm {
    fn normal_equations(&self, x: &[f64; 2], jtj: &mut SMatrix<f64, 2, 2>, jtr: &mut SVector<f64, 2>) -> f64 {
        let slope = if self.broken_derivative { f64::NAN } else { 1.0 / x[0] };
        jtj[(0, 0)] = slope * slope;
        jtr[0] = slope * x[0].ln();
        self.cost(x)
    }

    fn cost(&self, x: &[f64; 2]) -> f64 {
        0.5 * x[0].ln() * x[0].ln()
    }
}

#[test]
fn non_finite_trials_shorten_the_step_and_a_gene_without_influence_stays() {
    let bounds = Bounds::new([-100.0, 0.0], [100.0, 1.0]).unwrap();
    let found = levenberg_marquardt(
        &Logarithm {
            broken_derivative: false,
        },
        &bounds,
        [20.0, 0.4],
        &LmConfig::default(),
    );
    // A step is negligible below 1e-10 of the box, which is 200 wide.
    assert!((found.genes[0] - 1.0).abs() <= 2e-8, "{found:?}");
    assert_eq!(found.genes[1].to_bits(), 0.4f64.to_bits());
}

#[test]
fn a_start_without_finite_cost_or_derivative_is_returned_as_not_finite() {
    let bounds = Bounds::new([-100.0, 0.0], [100.0, 1.0]).unwrap();
    for (broken_derivative, start) in [(true, [20.0, 0.4]), (false, [-1.0, 0.4])] {
        let found = levenberg_marquardt(&Logarithm { broken_derivative }, &bounds, start, &LmConfig::default());
        assert_eq!(
            (found.genes, found.iterations, found.stop),
            (start, 1, LmStop::NotFinite)
        );
    }
}

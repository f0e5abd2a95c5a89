//! Number of operations of one integration step of the monitor, the arithmetic limit in `docs/performance.md`.

use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use ema_models::reference::Scenario;
use ema_models::{
    ActuatorParams, Calibration, ComparedSample, FaultVector, Feedback, Monitor, Real, STEPS_PER_CONTROL, SensedSample,
    Unknowns, prepare_window,
};

static COUNTS: [AtomicU32; 5] = [const { AtomicU32::new(0) }; 5];

/// Whether [`Real::known_true`] evaluates masks, so that the monitor takes its shortcuts.
static KNOWS: AtomicBool = AtomicBool::new(false);

/// Classes of operations.
#[derive(Clone, Copy)]
enum Class {
    Sum,
    Product,
    Root,
    /// `min`, `max`, comparisons, selections, signs.
    Choice,
    /// And, or, not of masks.
    Mask,
}

fn count(class: Class) {
    COUNTS[class as usize].fetch_add(1, Ordering::Relaxed);
}

/// A number that counts its operations.
#[derive(Clone, Copy)]
struct Counted(f64);

#[derive(Clone, Copy)]
struct CountedMask(bool);

macro_rules! binary {
    ($trait:ident, $method:ident, $class:ident, $op:tt) => {
        impl $trait for Counted {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                count(Class::$class);
                Self(self.0 $op other.0)
            }
        }
    };
}
binary!(Add, add, Sum, +);
binary!(Sub, sub, Sum, -);
binary!(Mul, mul, Product, *);
binary!(Div, div, Root, /);

impl Neg for Counted {
    type Output = Self;
    fn neg(self) -> Self {
        count(Class::Choice);
        Self(-self.0)
    }
}

impl BitAnd for CountedMask {
    type Output = Self;
    fn bitand(self, other: Self) -> Self {
        count(Class::Mask);
        Self(self.0 & other.0)
    }
}

impl BitOr for CountedMask {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        count(Class::Mask);
        Self(self.0 | other.0)
    }
}

impl Not for CountedMask {
    type Output = Self;
    fn not(self) -> Self {
        count(Class::Mask);
        Self(!self.0)
    }
}

impl Real for Counted {
    type Mask = CountedMask;
    fn splat(x: f64) -> Self {
        Self(x)
    }
    fn lt(self, other: Self) -> CountedMask {
        count(Class::Choice);
        CountedMask(self.0 < other.0)
    }
    fn le(self, other: Self) -> CountedMask {
        count(Class::Choice);
        CountedMask(self.0 <= other.0)
    }
    fn select(mask: CountedMask, if_true: Self, if_false: Self) -> Self {
        count(Class::Choice);
        if mask.0 { if_true } else { if_false }
    }
    fn known_true(mask: CountedMask) -> bool {
        KNOWS.load(Ordering::Relaxed) && mask.0
    }
    fn abs(self) -> Self {
        count(Class::Choice);
        Self(self.0.abs())
    }
    fn round(self) -> Self {
        count(Class::Sum);
        count(Class::Sum);
        Self(Real::round(self.0))
    }
    fn sqrt(self) -> Self {
        count(Class::Root);
        Self(self.0.sqrt())
    }
    fn min(self, other: Self) -> Self {
        count(Class::Choice);
        Self(Real::min(self.0, other.0))
    }
    fn max(self, other: Self) -> Self {
        count(Class::Choice);
        Self(Real::max(self.0, other.0))
    }
}

#[test]
fn a_step_costs_at_most_265_operations() {
    let all = per_step(false);
    assert!((100.0..265.0).contains(&all), "{all}");
    let short = per_step(true);
    assert!(short < 0.9 * all, "{short} of {all}");
}

/// Operations per step, including the shares of controller and sample, with or without the shortcuts of a single monitor.
fn per_step(shortcuts: bool) -> f64 {
    let params = ActuatorParams::bench();
    let sensed: Vec<SensedSample> = Scenario::new(params, FaultVector::NOMINAL, 3).run().collect();
    let mut samples = vec![ComparedSample::default(); sensed.len()];
    let initial = prepare_window(&params, &sensed, &[], 40, 0.0, &mut samples);
    let unknowns = Unknowns {
        fault: FaultVector::NOMINAL,
        load_torque: 0.0,
        integral: 0.0,
        motor: ema_models::MotorDeviation::default(),
    };
    let monitor = Monitor::new(&params, &Calibration::default(), params.motor.v_dc, &unknowns)
        .with_feedback(Feedback::Measured)
        .map(Counted);
    let mut state = monitor.start(&initial, &samples[0]);
    KNOWS.store(shortcuts, Ordering::Relaxed);
    COUNTS.iter().for_each(|c| c.store(0, Ordering::Relaxed));
    for pair in samples.windows(2) {
        monitor.run_sample_period(&mut state, &initial, &pair[0], &pair[1]);
    }
    let controls = (samples.len() - 1) as f64 / (params.sensors.sample_rate * params.controller.period);
    let steps = controls * f64::from(STEPS_PER_CONTROL);
    let [sums, products, roots, choices, masks] =
        [0, 1, 2, 3, 4].map(|n: usize| f64::from(COUNTS[n].load(Ordering::Relaxed)) / steps);
    let all = sums + products + roots + choices + masks;
    println!(
        "shortcuts {shortcuts}: {sums:.1} sums, {products:.1} products, {roots:.1} roots and divisions, {choices:.1} choices, \
         {masks:.1} of masks, {all:.1} in all"
    );
    all
}

//! What all windows of a unit share in the torque balance: the unknowns of commissioning, their priors, and their columns.
//!
//! The sum of the terms is zero; a row reads `Σ columns · unknowns = N_A + N_B + N_C parts`, so a column is minus the derivative of
//! the sum with respect to its unknown. The priors are the tolerances of a type. They keep columns apart that the windows do not
//! tell apart, and stand for what the windows do not show.

use ema_models::ActuatorParams;
use nalgebra::{SMatrix, SVector};

#[cfg(feature = "std")]
use super::terms::TERM_COUNT;
use super::terms::{BalanceRow, Term};

/// Shared terms besides the turns, whose sum is fixed.
const SHARED: [Term; 20] = [
    Term::EccentricityCos,
    Term::EccentricitySin,
    Term::Inertia,
    Term::DryFriction,
    Term::Stribeck,
    Term::Damping,
    Term::CoggingCos,
    Term::CoggingSin,
    Term::MeshCos,
    Term::MeshSin,
    Term::Resolver1Cos,
    Term::Resolver1Sin,
    Term::Resolver2Cos,
    Term::Resolver2Sin,
    Term::EmfHarmonics,
    Term::OffsetA,
    Term::OffsetB,
    Term::Latency,
    Term::SetpointHold,
    Term::CountedOutput,
];

/// Number of shared unknowns: `N_B − 1`, `N_C − 1`, the shared terms.
pub const SHARED_COUNT: usize = 2 + SHARED.len();

/// Place of the inertia.
#[cfg(feature = "std")]
pub(super) const INERTIA: usize = 4;

#[cfg(feature = "std")]
const _: () = assert!(matches!(SHARED[INERTIA - 2], Term::Inertia));

/// Shared unknowns.
pub(super) type Shared = SVector<f64, SHARED_COUNT>;

/// Their covariance, or sums of their products.
#[cfg(feature = "std")]
pub(super) type SharedMatrix = SMatrix<f64, SHARED_COUNT, SHARED_COUNT>;

/// Columns of the shared unknowns in a row.
pub(super) fn shared_columns(row: &BalanceRow) -> [f64; SHARED_COUNT] {
    let term = |term: Term| row.terms[term as usize];
    let [a, b, c] = [Term::TurnsA, Term::TurnsB, Term::TurnsC].map(term);
    let mut columns = [0.0; SHARED_COUNT];
    (columns[0], columns[1]) = (a - b, a - c);
    for (slot, shared) in columns[2..].iter_mut().zip(SHARED) {
        *slot = -term(shared);
    }
    columns
}

/// Place of a term among the shared unknowns.
#[cfg(feature = "std")]
pub(super) fn place_of(term: Term) -> Option<usize> {
    SHARED.iter().position(|&shared| shared == term).map(|place| 2 + place)
}

/// Whether a shared unknown is also free in a later window: turns and eccentricity.
pub(super) fn is_free(unknown: usize) -> bool {
    unknown < 4
}

/// Whether a shared unknown is a part of the friction, which wears as a whole.
pub(super) fn is_worn(unknown: usize) -> bool {
    unknown >= 2
        && matches!(
            SHARED[unknown - 2],
            Term::DryFriction | Term::Stribeck | Term::MeshCos | Term::MeshSin
        )
}

/// How the free coefficients `N_A, N_B, N_C, ζ cos φ_e, ζ sin φ_e` of a healthy window follow from the shared unknowns.
pub(super) fn free_of_shared() -> SMatrix<f64, 5, SHARED_COUNT> {
    let mut derivative = SMatrix::zeros();
    (derivative[(0, 0)], derivative[(0, 1)]) = (-1.0, -1.0);
    for m in 0..4 {
        derivative[(m + 1, m)] = 1.0;
    }
    derivative
}

/// Coefficients of all terms for given shared unknowns.
#[cfg(feature = "std")]
pub(super) fn coefficients(x: &Shared) -> [f64; TERM_COUNT] {
    let mut values = [0.0; TERM_COUNT];
    values[Term::TurnsA as usize] = 1.0 - x[0] - x[1];
    values[Term::TurnsB as usize] = 1.0 + x[0];
    values[Term::TurnsC as usize] = 1.0 + x[1];
    values[Term::GearLoss as usize] = 1.0;
    for (m, term) in SHARED.into_iter().enumerate() {
        values[term as usize] = x[2 + m];
    }
    values
}

/// Friction that any actuator may have, as a share of the peak torque at the highest speed.
#[cfg(feature = "std")]
pub const FRICTION_MIN_SHARE: f64 = 1e-3;

/// What is known of a shared unknown before any window: value and standard deviation.
#[cfg(feature = "std")]
pub(super) fn priors(params: &ActuatorParams) -> [(f64, f64); SHARED_COUNT] {
    let (motor, gear) = (&params.motor, &params.transmission);
    let peak = motor.torque_gain() * motor.i_max;
    // A data sheet may say none.
    let dry = gear.friction_dynamic.max(FRICTION_MIN_SHARE * peak);
    let damping = motor.c.max(FRICTION_MIN_SHARE * peak / params.controller.omega_max);
    core::array::from_fn(|unknown| {
        if unknown < 2 {
            return (0.0, 0.03);
        }
        match SHARED[unknown - 2] {
            Term::Inertia => (motor.j, 0.2 * motor.j),
            Term::DryFriction => (gear.friction_dynamic, 0.6 * dry),
            Term::Stribeck => (0.0, gear.friction_static - gear.friction_dynamic + 0.2 * dry),
            Term::Damping => (motor.c, 2.0 * damping),
            Term::CoggingCos | Term::CoggingSin => (0.0, 0.02 * peak),
            Term::MeshCos | Term::MeshSin => (0.0, 0.2 * dry),
            Term::Resolver1Cos | Term::Resolver1Sin | Term::Resolver2Cos | Term::Resolver2Sin => {
                (0.0, 0.01 * motor.j / motor.pole_pairs)
            }
            Term::OffsetA | Term::OffsetB => (0.0, 0.01 * motor.i_max),
            Term::Latency => (0.0, 2e-4),
            Term::SetpointHold => (0.5, 0.5),
            Term::CountedOutput => (0.5, 0.5),
            _ => (0.0, 0.05),
        }
    })
}

/// Variance by which the shared unknowns of one window differ from those of another, beyond what commissioning can know: a torque
/// step reaches the current the later the larger it is, ripple and dead time act as offsets.
pub(super) fn spread(params: &ActuatorParams) -> Shared {
    let (motor, gear) = (&params.motor, &params.transmission);
    Shared::from_fn(|unknown, _| {
        if unknown < 2 {
            return 0.0;
        }
        let sigma = match SHARED[unknown - 2] {
            Term::Inertia => 0.003 * motor.j,
            Term::DryFriction => 0.02 * gear.friction_dynamic,
            Term::OffsetA | Term::OffsetB => 3e-4 * motor.i_max,
            Term::Latency => 1e-5,
            Term::SetpointHold => 0.08,
            _ => 0.0,
        };
        sigma * sigma
    })
}

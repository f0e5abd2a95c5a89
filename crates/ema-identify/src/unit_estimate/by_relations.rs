//! A window of a commissioned unit by the relations between measured signals.

use std::vec::Vec;

use ema_models::{ActuatorParams, FAULT_COUNT, FaultId, FaultVector, MotorDeviation, SensedSample, Unknowns};

use super::UnitEstimate;
use crate::counter_alignment::align_counters;
use crate::estimate::{Estimate, UNMODELLED_COST};
use crate::inferred::{Inferred, InferredReadings};
use crate::relations::{
    Element, MeasuredWindow, MeasurementNoise, NoiseChange, Relation, RelationsEstimate, SinceCommissioning,
};
use crate::unit_calibration::UnitRelations;

/// A window's samples with both counters on the wraps that bring the angles together.
#[derive(Clone, Debug)]
pub struct AlignedWindow<'a> {
    params: &'a ActuatorParams,
    samples: Vec<SensedSample>,
    filled: &'a [usize],
    since: SinceCommissioning,
}

impl<'a> AlignedWindow<'a> {
    /// Of a window; those of the indices `filled` were not measured, and `output_zero` is that of its unit, rad, where it is
    /// [known](crate::output_zero).
    #[must_use]
    pub fn new(
        params: &'a ActuatorParams,
        window: &[SensedSample],
        filled: &'a [usize],
        output_zero: Option<f64>,
    ) -> Self {
        let mut samples = window.to_vec();
        // The relations read changes of the angles: what is left of a count matters to none.
        align_counters(params, &mut samples, output_zero);
        Self {
            params,
            samples,
            filled,
            since: SinceCommissioning::default(),
        }
    }

    /// The same with this being other than at commissioning.
    #[must_use]
    pub fn with(self, since: SinceCommissioning) -> Self {
        Self { since, ..self }
    }

    /// The window as the relations read it.
    #[must_use]
    pub fn measured(&self) -> MeasuredWindow<'_, SensedSample> {
        MeasuredWindow::new(self.params, &self.samples, self.filled).with(self.since)
    }
}

/// Residual of the torque balance that is usual with any unit, as a share of the largest torque.
const RESIDUAL_FLOOR: f64 = 5e-3;

/// Estimates one window by the relations of its unit.
///
/// The cost is `½ (r² + f²)/(r₀² + f²)`: r is the residual of the torque balance, r₀ that of healthy windows, f 0.5 % of the largest torque; where the torque
/// balance fails its residual test, no fault vector explains the window, and the cost says so. A fault whose own relation fails, controller
/// gain or backlash, is not observable. `is_locked`: the motor stood while it was commanded to move.
#[must_use]
pub fn estimate_by_relations(unit: &UnitRelations, window: &AlignedWindow<'_>, is_locked: bool) -> UnitEstimate {
    let measured = window.measured();
    let noise = MeasurementNoise::of(&measured).map(|now| NoiseChange {
        now,
        commissioned: unit.noise,
    });
    let found = unit.commissioned.estimate(&measured.with_noise(noise));
    let mut sigma = found.sigma;
    // Of the two components of the eccentricity the larger factor.
    let mut factors = [1.0; FAULT_COUNT];
    for element in Element::ALL {
        let factor = &mut factors[element.fault().parameter()];
        *factor = unit.sigma_factors[element as usize].max(*factor);
    }
    let motor = &window.params.motor;
    let unexplained: Vec<Relation> = Relation::ALL
        .into_iter()
        .filter(|&relation| !found.is_explained_by(relation))
        .collect();
    for relation in &unexplained {
        if let Some(fault) = own_fault(*relation) {
            sigma[fault.parameter()] = None;
        }
    }
    if unexplained == [Relation::Transmission] {
        // An output that is read wrongly, or late, changes the control deviation too.
        sigma[FaultId::Gain.parameter()] = None;
    }
    let floor = RESIDUAL_FLOOR * motor.torque_gain() * motor.i_max;
    // What a wide play explains does not count.
    let residual = if found.play_explains {
        unit.residual_rms_nm
    } else {
        found.torque_beyond_noise_rms
    };
    let ratio = residual.hypot(floor) / unit.residual_rms_nm.hypot(floor);
    let cost = 0.5 * ratio * ratio;
    let share = found.residual_share[Relation::TorqueBalance as usize];
    let least = if unexplained.contains(&Relation::TorqueBalance) {
        UNMODELLED_COST * share * share
    } else {
        0.0
    };
    let fault = FaultVector::from_array(found.k.map(|k| k.clamp(0.0, 1.0)));
    let estimate = Estimate {
        fault,
        unknowns: Unknowns {
            fault,
            load_torque: found.load_torque,
            integral: 0.0,
            motor: MotorDeviation::default(),
        },
        sigma,
        share: found.share,
        observable: found.observable(),
        cost: cost.max(least),
        residual_rms_a: found.torque_residual_rms / motor.torque_gain(),
        evaluations: 0,
        cut: false,
        competing_optimum: None,
        back_emf_off: 0.0,
        other_motor: false,
        locked: is_locked,
        deviations: std::vec::Vec::new(),
        inferred: inferred(&found),
    };
    UnitEstimate {
        estimate,
        needed: found.needed,
        unexplained,
        bridge_spread: found.bridge_spread,
    }
    .widened_by(&factors)
}

/// What the torque balance says of the load, and of the torque for each read current.
fn inferred(found: &RelationsEstimate) -> InferredReadings {
    let [k1, _, a, b, c, ..] = found.k;
    let [sigma_1, _, sigma_a, sigma_b, sigma_c, ..] = found.sigma;
    let turns = |k: f64, sigma: Option<f64>| sigma.map(|sigma| Inferred { value: 1.0 - k, sigma });
    InferredReadings {
        load_torque: found.load_sigma.map(|sigma| Inferred {
            value: found.load_torque,
            sigma,
        }),
        load_by_friction: None,
        dc_link: None,
        friction: sigma_1.map(|sigma| Inferred {
            value: 1.0 + 2.0 * k1,
            sigma: 2.0 * sigma,
        }),
        turns: [turns(a, sigma_a), turns(b, sigma_b), turns(c, sigma_c)],
    }
}

/// The fault that a relation alone shows.
fn own_fault(relation: Relation) -> Option<FaultId> {
    match relation {
        Relation::TorqueBalance => None,
        Relation::Controller => Some(FaultId::Gain),
        Relation::Transmission => Some(FaultId::Backlash),
    }
}

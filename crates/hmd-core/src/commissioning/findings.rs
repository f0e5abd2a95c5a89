//! What commissioning found, for people: parameters against their tolerances, both sides of each relation over one window, and what
//! windows that were left out show.

use ema_identify::Estimate;
use ema_identify::relations::{Curve, Element, Needed, RelationsEstimate, SinceCommissioning, Term};
use ema_identify::unit_calibration::{
    Deviation, Seen, UnitMonitor, UnitParameter, UnitRelations, change_since, elements_of, fault_of,
};
use ema_models::{ActuatorParams, FAULT_COUNT, FaultId, Tolerances};

use crate::assess::needed_in_words;
use crate::outbox::WindowJob;

/// What commissioning found.
#[derive(Clone, Debug, Default)]
pub struct Findings {
    /// Parameters in which the unit may differ from its type.
    pub parameters: Vec<FoundParameter>,
    /// Number of the window of the curves.
    pub curves_window: u64,
    /// Both sides of each relation over that window; none where the monitor assesses the unit and no relation was learnt.
    pub curves: Vec<Curve>,
    /// What the estimator says of each healthy window without having learnt from it.
    pub windows: Vec<HealthyWindow>,
    /// What the windows would have needed to show a fault; `None` for those that they show, and where it is not known.
    pub needed: [Option<&'static str>; FaultId::COUNT],
}

/// A parameter of the unit beside that of its type.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundParameter {
    /// Symbol of the notation.
    pub symbol: &'static str,
    /// Name for people.
    pub name: &'static str,
    /// Unit of all numbers.
    pub unit: &'static str,
    /// What found it: `relations` or `monitor`.
    pub found_by: &'static str,
    /// Value of the type.
    pub of_type: f64,
    /// Tolerance of the type, one standard deviation.
    pub tolerance: f64,
    /// Value of the unit.
    pub found: f64,
    /// One standard deviation of it, prior included.
    pub sigma: f64,
}

impl FoundParameter {
    /// Distance from the type, in tolerances.
    #[must_use]
    pub fn tolerances_off(&self) -> f64 {
        (self.found - self.of_type) / self.tolerance
    }

    /// Whether the windows say little of it: the standard deviation is nearly that of the type.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.sigma > OPEN_SHARE * self.tolerance
    }
}

/// Share of the tolerance from which a standard deviation on leaves a parameter open.
const OPEN_SHARE: f64 = 0.7;

/// A healthy window as the estimator sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HealthyWindow {
    /// Number of the window.
    pub number: u64,
    /// Apparent k1…k8, not limited to their range.
    pub k: [f64; FAULT_COUNT],
    /// One standard deviation; `None` where the window does not show it.
    pub sigma: [Option<f64>; FAULT_COUNT],
    /// Root-mean-square residual: of the torque balance, Nm, or of the monitor's current, A.
    pub residual_rms: f64,
}

/// The unit's parameters by both estimators; where both find one, that which assesses the unit comes first.
pub(super) fn parameters(
    job: &WindowJob,
    relations: Option<&UnitRelations>,
    monitor: Option<&UnitMonitor>,
) -> Vec<FoundParameter> {
    let (params, tolerances) = (&job.params, &job.actuator.tolerances);
    let of_relations = relations.map(|relations| by_relations(params, tolerances, relations));
    let of_monitor = monitor.map(|monitor| by_monitor(params, tolerances, monitor));
    of_relations.into_iter().chain(of_monitor).flatten().collect()
}

fn by_monitor(params: &ActuatorParams, tolerances: &Tolerances, monitor: &UnitMonitor) -> Vec<FoundParameter> {
    UnitParameter::ALL
        .into_iter()
        .map(|parameter| {
            let of_type = parameter.value(params);
            let Deviation { share, sigma } = monitor.parameters.of(parameter);
            let (symbol, unit) = notation(parameter);
            FoundParameter {
                symbol,
                name: parameter.name(),
                unit,
                found_by: "monitor",
                of_type,
                tolerance: parameter.tolerance(tolerances) * of_type,
                found: (1.0 + share) * of_type,
                sigma: sigma * of_type,
            }
        })
        .collect()
}

fn notation(parameter: UnitParameter) -> (&'static str, &'static str) {
    match parameter {
        UnitParameter::Resistance => ("R", "Ω"),
        UnitParameter::BackEmf => ("k", "V s/rad"),
        UnitParameter::Inductance => ("L", "H"),
        UnitParameter::Inertia => ("J", "kg m²"),
        UnitParameter::Damping => ("C", "Nm s/rad"),
        UnitParameter::DryFriction => ("T_d", "Nm"),
        UnitParameter::PositionGain => ("G_p", "1/s"),
        UnitParameter::SpeedGain => ("K_p", "Nm s/rad"),
        UnitParameter::IntegralGain => ("K_i", "Nm/rad"),
        UnitParameter::SpeedLimit => ("ω_max", "rad/s"),
        UnitParameter::CurrentLimit => ("I_max", "A"),
    }
}

/// Torques are relative to the type's k, so the tolerance of k is a part of theirs.
fn by_relations(params: &ActuatorParams, tolerances: &Tolerances, relations: &UnitRelations) -> Vec<FoundParameter> {
    let unit = &relations.commissioned;
    let (motor, usual) = (&params.motor, Tolerances::USUAL);
    let peak = motor.torque_gain() * motor.i_max;
    let own_or_usual = |of: fn(&Tolerances) -> f64| Some(of(tolerances)).filter(|own| *own > 0.0).unwrap_or(of(&usual));
    let of_k = UnitParameter::BackEmf.tolerance(tolerances);
    let mut rows = Vec::new();
    for (parameter, term) in [
        (UnitParameter::Inertia, Term::Inertia),
        (UnitParameter::Damping, Term::Damping),
        (UnitParameter::DryFriction, Term::DryFriction),
    ] {
        let of_type = parameter.value(params);
        let (symbol, unit_of) = notation(parameter);
        rows.push(FoundParameter {
            symbol,
            name: parameter.name(),
            unit: unit_of,
            found_by: "relations",
            of_type,
            tolerance: parameter.tolerance(tolerances).hypot(of_k) * of_type,
            found: unit.balance.of(term),
            sigma: unit.sigma_of(term).unwrap_or_default(),
        });
    }
    let play = unit.baseline[Element::Backlash as usize];
    if play.windows > 0 {
        let backlash = params.transmission.backlash;
        rows.push(FoundParameter {
            symbol: "b₀",
            name: "backlash",
            unit: "rad",
            found_by: "relations",
            of_type: backlash,
            tolerance: own_or_usual(|tolerances| tolerances.backlash) * backlash,
            found: play.mean,
            sigma: play.scatter.max(play.sigma) / (play.windows as f64).sqrt(),
        });
    }
    // Amplitudes of effects that the type does not have.
    let mut effect = |symbol, name, unit_of, tolerance: f64, terms: &[Term], per_term: f64| {
        let norm = |of: &dyn Fn(Term) -> f64| terms.iter().map(|&term| of(term)).fold(0.0, f64::hypot);
        let found = match terms {
            [term] => unit.balance.of(*term),
            _ => norm(&|term| unit.balance.of(term)),
        };
        let largest = terms.iter().filter_map(|&term| unit.sigma_of(term)).fold(0.0, f64::max);
        rows.push(FoundParameter {
            symbol,
            name,
            unit: unit_of,
            found_by: "relations",
            of_type: 0.0,
            tolerance,
            found: per_term * found,
            sigma: per_term.abs() * largest,
        });
    };
    let cogging = own_or_usual(|tolerances| tolerances.cogging) * peak;
    effect(
        "T_c",
        "cogging torque",
        "Nm",
        cogging,
        &[Term::CoggingCos, Term::CoggingSin],
        1.0,
    );
    let harmonics = own_or_usual(|tolerances| tolerances.emf_harmonics) * std::f64::consts::SQRT_2;
    effect(
        "h₅ − h₇",
        "back-EMF harmonics",
        "",
        harmonics,
        &[Term::EmfHarmonics],
        2.0,
    );
    // The coefficient is −J times the error at the motor shaft.
    let electrical = -motor.pole_pairs / unit.balance.of(Term::Inertia).max(f64::MIN_POSITIVE);
    let resolver = own_or_usual(|tolerances| tolerances.resolver_error);
    effect(
        "ε₁",
        "resolver error, 1st",
        "rad el.",
        resolver,
        &[Term::Resolver1Cos, Term::Resolver1Sin],
        electrical.abs(),
    );
    effect(
        "ε₂",
        "resolver error, 2nd",
        "rad el.",
        resolver,
        &[Term::Resolver2Cos, Term::Resolver2Sin],
        electrical.abs(),
    );
    // About the mean of three independent ones.
    let offset = own_or_usual(|tolerances| tolerances.current_offset) * (2.0_f64 / 3.0).sqrt();
    effect("o_A", "offset of i_A", "A", offset, &[Term::OffsetA], -1.0);
    effect("o_B", "offset of i_B", "A", offset, &[Term::OffsetB], -1.0);
    let latency = own_or_usual(|tolerances| tolerances.sample_latency) * std::f64::consts::SQRT_2;
    effect("τ", "age of the currents", "s", latency, &[Term::Latency], 1.0);
    rows
}

/// Healthy windows by relations that were learnt without them.
pub(super) fn windows_by_relations(
    jobs: &[WindowJob],
    relations: &UnitRelations,
    left_out: &[RelationsEstimate],
) -> Vec<HealthyWindow> {
    let mut factors = [1.0_f64; FAULT_COUNT];
    for element in Element::ALL {
        let factor = &mut factors[element.fault().parameter()];
        *factor = factor.max(relations.sigma_factors[element as usize]);
    }
    jobs.iter()
        .zip(left_out)
        .map(|(job, found)| HealthyWindow {
            number: job.window.number,
            k: found.k,
            sigma: std::array::from_fn(|p| found.sigma[p].map(|sigma| factors[p] * sigma)),
            residual_rms: found.torque_residual_rms,
        })
        .collect()
}

/// Healthy windows by the monitor, whose parameters were fitted to all of them; the mean is that of the others.
pub(super) fn windows_by_monitor(
    jobs: &[WindowJob],
    monitor: &UnitMonitor,
    estimates: &[Estimate],
) -> Vec<HealthyWindow> {
    jobs.iter()
        .zip(estimates)
        .map(|(job, estimate)| {
            let apparent = elements_of(&estimate.fault);
            let changes = Element::ALL.map(|element| {
                let baseline = &monitor.baseline[element as usize];
                let own = apparent[element as usize];
                let others = f64::from(baseline.windows) - 1.0;
                // The mean without this window.
                let mean = baseline.mean + (baseline.mean - own) / others.max(1.0);
                change_since(element, own, mean).0
            });
            HealthyWindow {
                number: job.window.number,
                k: fault_of(&changes).to_array(),
                sigma: estimate.sigma,
                residual_rms: estimate.residual_rms_a,
            }
        })
        .collect()
}

/// Each fault of a window by the estimator that shows it better.
pub(super) fn windows_by_both(relations: Vec<HealthyWindow>, monitor: &[HealthyWindow]) -> Vec<HealthyWindow> {
    let mut windows = relations;
    for (window, other) in windows.iter_mut().zip(monitor) {
        let sigma = |window: &HealthyWindow, p: usize| window.sigma[p].unwrap_or(f64::INFINITY);
        for p in FaultId::ALL.map(FaultId::parameter) {
            if sigma(other, p) < sigma(window, p) {
                (window.k[p], window.sigma[p]) = (other.k[p], other.sigma[p]);
            }
        }
    }
    windows
}

/// Both sides of each relation over the window that excites most: that with the most rows.
pub(super) fn curves(jobs: &[WindowJob], relations: &UnitRelations, seen: &Seen) -> (u64, Vec<Curve>) {
    let of = |job: &WindowJob| {
        let since = SinceCommissioning {
            winding_temp: seen.winding_temp(job.conditions.winding_temp_deg_c),
            ..SinceCommissioning::default()
        };
        let aligned = job.window.aligned(&job.params, since);
        let window = aligned.measured();
        let estimate = relations.commissioned.estimate(&window);
        (
            estimate.torque_rows,
            relations.commissioned.curves(&window, &estimate).to_vec(),
        )
    };
    let drawn = jobs.iter().map(|job| (job.window.number, of(job)));
    let best = drawn.reduce(|best, next| if next.1.0 > best.1.0 { next } else { best });
    best.map_or((0, Vec::new()), |(number, (_, curves))| (number, curves))
}

/// What the windows needed most often to show a fault that half of them or more do not.
pub(super) fn needed(left_out: &[[Option<Needed>; FAULT_COUNT]]) -> [Option<&'static str>; FaultId::COUNT] {
    FaultId::ALL.map(|fault| {
        let found: Vec<&'static str> = left_out
            .iter()
            .filter_map(|needed| needed[fault.parameter()])
            .map(needed_in_words)
            .collect();
        let most = found
            .iter()
            .max_by_key(|words| found.iter().filter(|other| other == words).count());
        most.copied().filter(|_| 2 * found.len() >= left_out.len())
    })
}

//! A commissioned unit, and what a later window says of it: the change of each element since commissioning.

mod readings;

use core::f64::consts::{PI, TAU};

use ema_models::{FAULT_COUNT, FaultVector};

use super::balance_coefficients::BalanceCoefficients;
use super::baseline::Baseline;
use super::between_samples::coarse_torque_error;
use super::change::{ModelError, change, healthy, needed_for};
use super::elements::{ELEMENT_COUNT, Element, ElementReadings, Needed, Reading};
use super::gear_loss::Directions;
use super::hidden_torque::unseen_share;
use super::measured::MeasuredWindow;
use super::output_load::OutputLoad;
use super::residual::{HealthyResidual, RELATION_COUNT, Relation};
use super::shared::SHARED_COUNT;
use super::shorted_loop::ShortedShare;
use super::terms::Term;
use super::transmission::{REACH_SHARE, REACH_SHARE_BENDING};
use crate::estimate::{OBSERVABLE_SIGMA, beside, damage_per_change};
use crate::recorded_sample::RecordedSample;

pub(super) use readings::Balance;

/// What the healthy windows of a unit have in common.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "std", derive(serde::Serialize, serde::Deserialize))]
pub struct CommissionedRelations {
    /// Coefficients of the torque balance.
    pub balance: BalanceCoefficients,
    /// Covariance of the shared unknowns of the balance: `N_B − 1`, `N_C − 1`, the terms from eccentricity to set point.
    pub covariance: [[f64; SHARED_COUNT]; SHARED_COUNT],
    /// Half width of the kernel of the controller's relation, s.
    pub gain_half_width_s: f64,
    /// What the healthy windows show of each element, in the order of [`Element::ALL`].
    pub baseline: [Baseline; ELEMENT_COUNT],
    /// Residuals of the healthy windows, in the order of [`Relation::ALL`].
    pub residual: [HealthyResidual; RELATION_COUNT],
    /// Time from the logged set point to its effect in the healthy windows, s; without windows in unit files that have none.
    #[cfg_attr(feature = "std", serde(default))]
    pub setpoint_delay: Baseline,
    /// Scale of the torque in the law of the speed loop; without it each window has to show it by itself, as in older unit files.
    #[cfg_attr(feature = "std", serde(default, skip_serializing_if = "Option::is_none"))]
    pub torque_scale: Option<f64>,
    /// Whether the baseline of the gain is that of a set point that takes effect when it is logged; false in older unit files, whose gains
    /// hold for the motion and the delay of commissioning.
    #[cfg_attr(feature = "std", serde(default))]
    pub gain_without_delay: bool,
    /// Largest mean load at the output of a healthy window, Nm; without it in older unit files, and where no window tells it from friction.
    #[cfg_attr(feature = "std", serde(default, skip_serializing_if = "Option::is_none"))]
    pub output_load: Option<f64>,
    /// Largest difference between the load that a healthy window shows and the one that is measured, less what chance explains, Nm; without it
    /// none was measured, or no window tells a load from friction.
    #[cfg_attr(feature = "std", serde(default, skip_serializing_if = "Option::is_none"))]
    pub load_error: Option<f64>,
    /// Whether the gear may bend, though no spring explains the healthy windows clearly better than a rigid mass.
    #[cfg_attr(feature = "std", serde(default, skip_serializing_if = "core::ops::Not::not"))]
    pub may_bend: bool,
}

/// Faults of one window as changes since commissioning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelationsEstimate {
    /// Apparent k1…k8, in index order of the fault vector and not limited to its range: noise makes small ones negative. k7 is
    /// the direction of the change of eccentricity, in [0, 1]. Without observation the nominal value.
    pub k: [f64; FAULT_COUNT],
    /// One standard deviation of each; `None` where it is not observable.
    pub sigma: [Option<f64>; FAULT_COUNT],
    /// What the window would have needed to show a parameter; `None` where it is observable, and for k7 where the eccentricity
    /// does not stand clear of its own uncertainty.
    pub needed: [Option<Needed>; FAULT_COUNT],
    /// The part of each sigma that comes from the unknown bridge of a shorted loop: of a phase whose shorted turns carry a current.
    pub bridge_spread: [f64; FAULT_COUNT],
    /// The part of each sigma that is a share of the damage itself: it hides no large damage.
    pub share: [f64; FAULT_COUNT],
    /// Residual of each relation as a share of the largest that is explained, in the order of [`Relation::ALL`]; below 1 also where the
    /// relation has no rows.
    pub residual_share: [f64; RELATION_COUNT],
    /// Whether the torque balance does not hold because a load behind a compliant transmission leaves the motor within a wide play.
    pub play_explains: bool,
    /// Root-mean-square residual of the torque balance, Nm.
    pub torque_residual_rms: f64,
    /// The same without what noise explains of it beyond that of the healthy windows.
    #[cfg(feature = "std")]
    pub torque_beyond_noise_rms: f64,
    /// Rows of the torque balance.
    pub torque_rows: usize,
    /// Constant load at the output, Nm; positive opposes positive motion.
    pub load_torque: f64,
    /// Its standard deviation; `None` where the motion, in one direction, does not tell it from friction.
    pub load_sigma: Option<f64>,
    /// Stiffness of a spring load at the output about its first angle, Nm/rad.
    pub spring_stiffness: f64,
}

impl RelationsEstimate {
    /// Whether a relation explains the window.
    #[must_use]
    pub fn is_explained_by(&self, relation: Relation) -> bool {
        self.residual_share[relation as usize] < 1.0
    }

    /// Whether the sigma of each damage is at most 0.1, without what grows with the damage and what comes from a bridge.
    #[must_use]
    pub fn observable(&self) -> [bool; FAULT_COUNT] {
        core::array::from_fn(|n| {
            let part = libm::hypot(self.share[n], self.bridge_spread[n]);
            self.sigma[n].is_some_and(|sigma| damage_per_change(n) * beside(sigma, part) <= OBSERVABLE_SIGMA)
        })
    }
}

impl CommissionedRelations {
    /// Estimates the faults of one window of the unit.
    ///
    /// `k1 = (s/s₀ − 1)/2`, `k2 = (b − b_u)/(99 b₀)`, `k3…k5 = 1 − N_j/N_j₀`, `ζ = |ζ⃗ − ζ⃗₀|`, `k8 = g/g₀ − ½`: index 0 (and
    /// `b_u`) are the commissioned unit's values, `b₀` is the type's play. Of a phase with a shorted loop, the share that belongs to its
    /// admittance. Derived here from the definition of the fault vector.
    #[must_use]
    pub fn estimate<S: RecordedSample>(&self, window: &MeasuredWindow<'_, S>) -> RelationsEstimate {
        let nominal_gain = &self.baseline[Element::Gain as usize];
        let (readings, balance) = self.readings(window, Some(nominal_gain));
        self.changes(window, &readings, &balance)
    }

    /// What the readings of a window say of the faults. Apart from the readings, whose stack is the deepest.
    #[inline(never)]
    fn changes<S: RecordedSample>(
        &self,
        window: &MeasuredWindow<'_, S>,
        readings: &ElementReadings,
        balance: &Balance,
    ) -> RelationsEstimate {
        let nominal_gain = &self.baseline[Element::Gain as usize];
        let unseen = unseen_share(window);
        // With another position gain the loop moves the actuator otherwise under the same command.
        let differs = |gain: Reading| libm::fabs(gain.value - nominal_gain.mean) > CLEAR * gain.sigma;
        let same_motion = !window.is_other_motion() && !readings.get(Element::Gain).is_ok_and(differs);
        let asymmetry = if same_motion {
            0.0
        } else {
            self.balance.hidden_asymmetry()
        };
        let error_of = |element: Element| {
            let error = ModelError::of(element, window.params().sensors.sample_rate, unseen, asymmetry);
            if element == Element::Backlash {
                let share = libm::hypot(error.share, balance.play_share);
                ModelError { share, ..error }
            } else {
                error
            }
        };
        // With less noise than at commissioning, readings of the torque balance are surer than those of the healthy windows.
        #[cfg(feature = "std")]
        let calm = balance.torque_residual.calm;
        #[cfg(not(feature = "std"))]
        let calm = 1.0;
        let calm_of = |element: Element| if Element::BALANCE.contains(&element) { calm } else { 1.0 };
        let change_of = |element: Element| {
            let baseline = &self.baseline[element as usize];
            let reading = readings
                .get(element)
                .and_then(|reading| baseline.widened(reading, same_motion, calm_of(element)))?;
            let changed = change(element, reading, baseline.mean, window.params());
            let error = error_of(element);
            let sigma = libm::hypot(changed.sigma, error.floor);
            // A sum that is not a number is no observation. The share does not count: it hides no large damage.
            let of_damage = damage_per_change(element.fault().parameter()) * sigma;
            if !changed.value.is_finite() || of_damage.is_nan() || of_damage > OBSERVABLE_SIGMA {
                let by_commissioning = damage_per_change(element.fault().parameter()) * error.floor > OBSERVABLE_SIGMA;
                return Err(if by_commissioning {
                    Needed::CommissioningThatShowsIt
                } else {
                    needed_for(element)
                });
            }
            if element == Element::Backlash && changed.value < CLEAR * sigma && !balance.flanks.are_shown() {
                return Err(Needed::OpenReversal);
            }
            let share = error.share * (changed.value - healthy(element));
            let by_load = if element == Element::Friction {
                self.friction_by_load(&balance.load, window)
            } else {
                0.0
            };
            Ok(Reading {
                sigma: libm::hypot(libm::hypot(sigma, share), by_load),
                ..changed
            })
        };
        let mut changes = Element::ALL.map(change_of);
        let play = &mut changes[Element::Backlash as usize];
        // A play that is not read at all may be closed as well.
        if play.is_err() && !balance.flanks.are_shown() {
            *play = Err(Needed::OpenReversal);
        }
        let share = Element::ALL.map(|element| {
            let of = |changed: Reading| error_of(element).share * libm::fabs(changed.value - healthy(element));
            changes[element as usize].map_or(0.0, of)
        });
        let mut bridge_spread = [0.0; FAULT_COUNT];
        if let Some((phase, admittance)) = balance.shorted {
            let element = Element::BALANCE[phase];
            let share = ShortedShare::of(admittance.value, window.motor().r_s);
            bridge_spread[element.fault().parameter()] = share.deviation;
            let error = error_of(element);
            let own = libm::hypot(share.slope * admittance.sigma, error.floor);
            changes[element as usize] = Ok(Reading {
                value: share.mean,
                sigma: libm::hypot(own, share.deviation),
            });
        }
        // What coarser samples do not show of the torque, no finer ones of commissioning left either.
        let besides = |relation: Relation| match relation {
            Relation::TorqueBalance if window.is_other_rate() => coarse_torque_error(window.params()),
            _ => 0.0,
        };
        let mut residual_share = Relation::ALL.map(|relation| {
            self.residual[relation as usize].share_of_limit(balance.residuals[relation as usize], besides(relation))
        });
        let torque_share = &mut residual_share[Relation::TorqueBalance as usize];
        let is_wider = |sigmas: f64| {
            let play = changes[Element::Backlash as usize];
            play.is_ok_and(|change| change.value > sigmas * change.sigma)
        };
        let (is_wide, may_be_wide) = (is_wider(CLEAR), is_wider(1.0));
        let more = self.residual[Relation::TorqueBalance as usize]
            .relative(balance.residuals[Relation::TorqueBalance as usize]);
        let leaves_more = more > PLAY_RESIDUAL;
        let play_explains = is_wide && leaves_more && (balance.play_share > 0.0 || self.reach_share().is_some());
        if play_explains {
            *torque_share = 0.0;
            for element in Element::BALANCE {
                changes[element as usize] = Err(Needed::NarrowPlay);
            }
        } else if may_be_wide && leaves_more {
            // A gear that bends too little for the healthy windows to show it: its flanks hit each other in time with the motion, which no
            // scatter shows.
            for element in Element::BALANCE {
                if bridge_spread[element.fault().parameter()] <= 0.0
                    && let Ok(change) = &mut changes[element as usize]
                {
                    change.sigma *= more;
                }
            }
        }
        let mut estimate = RelationsEstimate {
            k: FaultVector::NOMINAL.to_array(),
            sigma: [None; FAULT_COUNT],
            needed: [None; FAULT_COUNT],
            bridge_spread,
            share: [0.0; FAULT_COUNT],
            residual_share,
            play_explains,
            #[cfg(feature = "std")]
            torque_residual_rms: balance.torque_residual.rms,
            #[cfg(not(feature = "std"))]
            torque_residual_rms: balance.residuals[Relation::TorqueBalance as usize].rms,
            #[cfg(feature = "std")]
            torque_beyond_noise_rms: balance.torque_residual.beyond_noise_rms,
            torque_rows: balance.rows,
            load_torque: balance.load.constant,
            load_sigma: balance.load_sigma,
            spring_stiffness: balance.load.spring,
        };
        for (element, changed) in Element::ALL.into_iter().zip(changes) {
            if !matches!(element, Element::EccentricityCos | Element::EccentricitySin) {
                let parameter = element.fault().parameter();
                estimate.report(parameter, changed);
                // Of a shorted loop the bridge is what grows with the damage.
                if bridge_spread[parameter] <= 0.0 {
                    estimate.share[parameter] = share[element as usize];
                }
            }
        }
        let component = |element: Element| changes[element as usize];
        match (component(Element::EccentricityCos), component(Element::EccentricitySin)) {
            (Ok(cos), Ok(sin)) => {
                estimate.report_eccentricity(cos, sin);
                let [along, across] = [Element::EccentricityCos, Element::EccentricitySin].map(|e| share[e as usize]);
                estimate.share[ECCENTRICITY] = along.max(across);
            }
            (Err(needed), _) | (_, Err(needed)) => estimate.report(ECCENTRICITY, Err(needed)),
        }
        estimate
    }
}

impl CommissionedRelations {
    /// Standard deviation of the reach of the play as a share of it, of a gear that bends, or may.
    fn reach_share(&self) -> Option<f64> {
        if self.may_bend {
            Some(REACH_SHARE_BENDING)
        } else {
            (!self.balance.shape.compliance.is_rigid()).then_some(REACH_SHARE)
        }
    }

    /// Load, Nm, by which the balance of a healthy window may contradict a sensor of it.
    #[must_use]
    pub fn healthy_load_error(&self) -> f64 {
        let of_bending = self.output_load.filter(|_| self.may_bend);
        self.load_error.or(of_bending).unwrap_or(0.0)
    }

    /// One standard deviation of k1 by what the gear loses under the load that a window shows beyond those of commissioning and beyond the
    /// measured one. Motion in one direction shows no friction. 0 where the load of commissioning is not known.
    fn friction_by_load<S: RecordedSample>(&self, load: &OutputLoad, window: &MeasuredWindow<'_, S>) -> f64 {
        let since = window.since();
        let Some(known) = self.output_load else { return 0.0 };
        let beyond = load.mean_magnitude(&window.travel()) - known.max(libm::fabs(since.measured_load.unwrap_or(0.0)));
        let gear_ratio = window.params().transmission.gear_ratio;
        let dry_friction = self.balance.of(Term::DryFriction);
        let sigma = &since.gear_loss_sigma;
        sigma.of_friction(beyond, Directions::Both, gear_ratio, dry_friction)
    }
}

/// Place of k6 in the fault vector.
const ECCENTRICITY: usize = FaultVector::ECCENTRICITY_PHASE_INDEX - 1;

impl RelationsEstimate {
    fn report(&mut self, parameter: usize, changed: Result<Reading, Needed>) {
        match changed {
            Ok(Reading { value, sigma }) => (self.k[parameter], self.sigma[parameter]) = (value, Some(sigma)),
            Err(needed) => self.needed[parameter] = Some(needed),
        }
    }

    /// Amplitude and direction of the change `(ζ cos φ_e, ζ sin φ_e)`, with the standard deviations along it,
    /// `√((cos φ_e σ_c)² + (sin φ_e σ_s)²)`, and across it.
    fn report_eccentricity(&mut self, cos: Reading, sin: Reading) {
        let amplitude = libm::hypot(cos.value, sin.value);
        let of_both = |a: f64, b: f64| libm::hypot(a, b) / amplitude;
        let along = of_both(cos.value * cos.sigma, sin.value * sin.sigma);
        let across = of_both(sin.value * cos.sigma, cos.value * sin.sigma);
        let largest = cos.sigma.max(sin.sigma);
        // No change has no direction.
        let sigma = if along.is_finite() { along } else { largest };
        self.report(
            ECCENTRICITY,
            Ok(Reading {
                value: amplitude,
                sigma,
            }),
        );
        if amplitude > CLEAR * largest {
            let direction = Reading {
                value: 0.5 * (libm::atan2(sin.value, cos.value) / PI + 1.0),
                sigma: across / amplitude / TAU,
            };
            self.report(FaultVector::ECCENTRICITY_PHASE_INDEX, Ok(direction));
        }
    }
}

/// Standard deviations from zero at which an eccentricity has a direction, and a play is seen.
const CLEAR: f64 = 3.0;

/// Residual of the torque balance, relative to that of the healthy windows, from which the play of a compliant transmission is a part of it:
/// above that of windows with other faults.
const PLAY_RESIDUAL: f64 = 1.2;

//! What the relations of a commissioned unit read off one window: each element, and its torque balance.

use super::{CommissionedRelations, PLAY_RESIDUAL};
use crate::recorded_sample::RecordedSample;
use crate::relations::baseline::Baseline;
#[cfg(feature = "std")]
use crate::relations::compliance::Compliance;
use crate::relations::controller::{LawKnowledge, gain_ratio};
use crate::relations::elements::{Element, ElementReadings, Needed, Reading};
use crate::relations::flanks::Flanks;
#[cfg(feature = "std")]
use crate::relations::kernel::Kernel;
use crate::relations::measured::MeasuredWindow;
#[cfg(feature = "std")]
use crate::relations::measurement_noise::{NoiseGains, NoiseRise};
use crate::relations::output_load::OutputLoad;
use crate::relations::residual::{RELATION_COUNT, Relation, Residual};
use crate::relations::setpoint_delay::{SetpointDelay, setpoint_delay};
use crate::relations::terms::Term;
use crate::relations::torque_balance::{TorqueBalance, Turns, torque_balance};
use crate::relations::transmission::{REACH_SHARE_BENDING, play_width};

/// Range of the gain factor `0.5 + k8`.
const MIN_GAIN: f64 = 0.5;
const MAX_GAIN: f64 = 1.5;

impl CommissionedRelations {
    /// What is known of the law of the speed loop in a window in which this time of the set point is found.
    pub(in super::super) fn law_knowledge(&self, found: Option<&SetpointDelay>) -> LawKnowledge {
        let healthy = self.setpoint_delay.mean;
        let delay_s = found.map_or(healthy, |found| found.delay_s.value);
        let own = if self.gain_without_delay { 0.0 } else { healthy };
        LawKnowledge {
            scale: self.torque_scale,
            delay_s: Some(delay_s - own),
        }
    }

    /// The gain ratio of a window, with the time of its set point, as far as that is shown; of healthy windows with that of all of them.
    fn gain_in_time<S: RecordedSample>(
        &self,
        window: &MeasuredWindow<'_, S>,
        is_healthy: bool,
    ) -> Result<(Reading, Residual), Needed> {
        let healthy = &self.setpoint_delay;
        let is_comparable = self.gain_without_delay || healthy.windows > 0;
        let found = setpoint_delay(window, self.torque_scale).filter(|_| is_comparable);
        let used = found.as_ref().filter(|_| !is_healthy);
        let (mut gain, residual) = gain_ratio(window, self.gain_half_width_s, self.law_knowledge(used))?;
        #[cfg(feature = "std")]
        let residual = self.law_residual_beyond_noise(window, residual);
        if let Some(found) = used {
            let of_mean = healthy.scatter / libm::sqrt(healthy.windows.max(1) as f64);
            let sigma = libm::hypot(found.delay_s.sigma, of_mean);
            gain.sigma = libm::hypot(gain.sigma, found.gain_per_s * sigma);
        }
        Ok((gain, residual))
    }

    /// The residual of the law of the speed loop as what it is against that of the healthy windows, without what noise explains of it.
    #[cfg(feature = "std")]
    fn law_residual_beyond_noise<S: RecordedSample>(
        &self,
        window: &MeasuredWindow<'_, S>,
        residual: Residual,
    ) -> Residual {
        let healthy = &self.residual[Relation::Controller as usize];
        let Some(noise) = window.noise().filter(|_| healthy.windows > 0) else {
            return residual;
        };
        let rate = window.params().sensors.sample_rate;
        let kernel = Kernel::new(self.gain_half_width_s, rate, &Compliance::RIGID);
        let gains = NoiseGains::of_law(window, &kernel);
        let rise = NoiseRise::new(noise, &gains, libm::exp(healthy.mean_log), residual.independent);
        Residual {
            rms: rise.beyond(residual.rms) / rise.calm,
            ..residual
        }
    }

    /// Readings of all elements of one window, and its torque balance; the gain relative to that of healthy windows, where it is
    /// known, scales what the set point adds to the torque. Without one the window is healthy.
    pub(in super::super) fn readings<S: RecordedSample>(
        &self,
        window: &MeasuredWindow<'_, S>,
        healthy_gain: Option<&Baseline>,
    ) -> (ElementReadings, Balance) {
        let gain = self.gain_in_time(window, healthy_gain.is_none());
        let turns = healthy_gain.map_or(Turns::Healthy, |_| Turns::InUse);
        let relative_gain = match (gain, healthy_gain) {
            (Ok((gain, _)), Some(healthy)) if healthy.windows > 0 => {
                (gain.value / healthy.mean).clamp(MIN_GAIN, MAX_GAIN)
            }
            _ => 1.0,
        };
        let TorqueBalance {
            mut readings,
            load,
            load_sigma,
            residual_rms,
            #[cfg(feature = "std")]
            beyond_noise_rms,
            #[cfg(feature = "std")]
            rise,
            rows,
            independent,
            shorted,
        } = torque_balance(window, &self.balance, relative_gain, Some(&self.covariance), turns);
        let friction = self.balance.of(Term::DryFriction) / self.balance.of(Term::Inertia);
        let deceleration = libm::fabs(friction) / window.params().transmission.gear_ratio;
        let transmission = &self.residual[Relation::Transmission as usize];
        let holding = libm::fabs(self.balance.of(Term::DryFriction)) * window.params().transmission.gear_ratio;
        let flanks = Flanks::of(window, &load, holding);
        let torque = Residual {
            #[cfg(feature = "std")]
            rms: beyond_noise_rms / rise.calm,
            #[cfg(not(feature = "std"))]
            rms: residual_rms,
            independent,
        };
        let is_hit = self.residual[Relation::TorqueBalance as usize].relative(torque) > PLAY_RESIDUAL;
        let of_held = (flanks.may_be_held() && is_hit).then_some(REACH_SHARE_BENDING);
        let reach_share = self.reach_share().or(of_held);
        let play = play_width(window, transmission, deceleration, reach_share, is_hit, &flanks);
        readings.put(Element::Backlash, play.map(|play| play.width));
        readings.put(Element::Gain, gain.map(|(gain, _)| gain));
        (
            readings,
            Balance {
                load,
                load_sigma,
                residuals: [
                    torque,
                    gain.map_or(Residual::default(), |(_, residual)| residual),
                    play.map_or(Residual::default(), |play| play.residual),
                ],
                #[cfg(feature = "std")]
                torque_residual: TorqueResidual {
                    rms: residual_rms,
                    beyond_noise_rms,
                    calm: rise.calm,
                },
                flanks,
                play_share: play.map_or(0.0, |play| play.reach_share),
                rows,
                shorted,
            },
        )
    }
}

/// Residual of the torque balance of a window, and what its noise makes of it.
#[cfg(feature = "std")]
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueResidual {
    /// Root-mean-square, Nm.
    pub(super) rms: f64,
    /// The same without what noise explains beyond that of the healthy windows.
    pub(super) beyond_noise_rms: f64,
    /// Residual that a healthy window has with the noise of this one, where that is less than at commissioning, as a share of theirs.
    pub(super) calm: f64,
}

/// What the relations say besides the elements.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Balance {
    pub(in super::super) load: OutputLoad,
    pub(in super::super) load_sigma: Option<f64>,
    /// Residual of each relation, in the order of [`Relation::ALL`].
    pub(in super::super) residuals: [Residual; RELATION_COUNT],
    /// Residual of the torque balance as it is.
    #[cfg(feature = "std")]
    pub(super) torque_residual: TorqueResidual,
    /// Flanks of the play that the load leaves to the motion.
    pub(super) flanks: Flanks,
    /// Standard deviation of a play that is the reach of the output as a share of it; else 0.
    pub(super) play_share: f64,
    pub(super) rows: usize,
    /// Phase and admittance of a shorted loop, 1/Ω.
    pub(super) shorted: Option<(usize, Reading)>,
}

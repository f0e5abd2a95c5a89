//! Quality of a window's samples: complete, degraded or invalid, and why.

use core::fmt;

/// Whether the samples of a window are fit for an assessment.
#[derive(Clone, Debug, PartialEq)]
pub enum WindowQuality {
    /// Every sample is there and plausible.
    Complete,
    /// Fit, with these handicaps.
    Degraded(Vec<Degradation>),
    /// Not fit; the window must not be assessed, and this is no fault of the actuator.
    Invalid(Invalidity),
}

impl WindowQuality {
    /// Whether the window may be identified.
    #[must_use]
    pub fn is_fit(&self) -> bool {
        !matches!(self, Self::Invalid(_))
    }
}

/// A handicap of a window that is assessed all the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Degradation {
    /// Samples were interpolated.
    Filled {
        /// Samples missing by their counter.
        lost: u64,
        /// Samples received and refused, in whole or in part.
        rejected: u64,
    },
    /// So many samples hold what the one before held; they were refused.
    Repeated(u64),
    /// Another actuation begins in the window.
    AnotherActuation {
        /// Index of the sample at which it begins.
        at: usize,
    },
    /// The setpoint rested before the trigger, but the motor did not follow it: the state at the start is less certain.
    UnsteadyStart {
        /// Mean speed of the motor before the trigger, in speed mode less its setpoint, rad/s.
        speed_rad_s: f64,
    },
    /// No counter numbers the samples, and their stamps scatter about even steps.
    TimeJitter {
        /// Root mean square, as a share of a period.
        of_period: f64,
    },
}

/// Why a window is not fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Invalidity {
    /// It ended before its time.
    CutShort(CutShort),
    /// The mode changed from position to speed or back.
    ModeChanged,
    /// The command jumped while samples were missing; the time of the jump is unknown.
    CommandInGap {
        /// Index of the first sample after the gap.
        at: usize,
    },
    /// Too many samples are missing or refused, or too many in a row.
    TooManyFlawed {
        /// The most frequent reason.
        defect: Defect,
        /// Missing and refused samples, whatever the reason.
        count: usize,
        /// Longest run of them.
        longest: usize,
    },
    /// A signal stood still while another shows that it should have moved.
    Stuck(Signal),
    /// A counter jumped, and stayed there.
    CounterJumped {
        /// Which.
        counter: Counter,
        /// Index of the first sample after the jump.
        at: usize,
    },
    /// A counter is slower than the samples: it stands for several of them at a time.
    Held {
        /// Which.
        counter: Counter,
        /// Samples.
        samples: usize,
    },
    /// Resolver and encoder went different ways, further than any play and wear of the transmission.
    CountersDisagree {
        /// Range of the difference of the two angles, rad at the output.
        range_rad: f64,
    },
    /// Command and motor were moving before the trigger: what came before is not known, and acts on.
    StartInMotion {
        /// Range of the motor angle before the trigger, rad.
        turned_rad: f64,
    },
    /// No counter numbers the samples, and their stamps scatter about even steps by so much that samples seem lost, or angles to jump.
    TimeJitter {
        /// Root mean square, as a share of a period.
        of_period: f64,
    },
    /// The stamps do not advance at the sample rate that the type has.
    SampleRate {
        /// The type's rate, Hz.
        configured_hz: f64,
        /// The rate by the stamps, Hz.
        by_stamps_hz: f64,
    },
}

/// What ended a window before its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CutShort {
    /// No more samples.
    StreamEnded,
    /// The drive was switched off.
    WentIdle,
    /// The sample counter went back: the device restarted, or samples came out of order.
    CounterWentBack,
    /// Samples come at another rate since.
    RateChanged,
}

/// Why a sample, or a part of it, cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Defect {
    /// It did not come.
    Missing,
    /// A current is no number.
    NotFinite,
    /// A current is beyond the converters' full scale.
    BeyondScale,
    /// A converter is at its limit.
    Clipped,
    /// The three currents do not sum to zero.
    CurrentSum,
    /// The resolver's count does not fit those before and after it.
    MotorSpike,
    /// The encoder's count does not fit those before and after it.
    OutputSpike,
    /// The setpoint or the mode lasted one sample only, or is no number.
    CommandGlitch,
    /// It holds what the one before held, while the motor turned.
    Repeated,
}

impl Defect {
    pub(super) const ALL: [Self; 9] = [
        Self::Missing,
        Self::NotFinite,
        Self::BeyondScale,
        Self::Clipped,
        Self::CurrentSum,
        Self::MotorSpike,
        Self::OutputSpike,
        Self::CommandGlitch,
        Self::Repeated,
    ];
}

/// A signal that may be stuck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// The three phase currents.
    Currents,
    /// Motor resolver.
    Motor,
    /// Output encoder.
    Output,
}

/// One of the two counters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counter {
    /// Motor resolver.
    Motor,
    /// Output encoder.
    Output,
}

/// The parts of a sample that come in different frames and are refused each for itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Currents,
    Motor,
    Output,
    Setpoint,
}

impl Part {
    pub(super) const COUNT: usize = 4;
}

impl fmt::Display for Degradation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Filled { lost, rejected } => write!(f, "{lost} samples lost and {rejected} refused, filled"),
            Self::Repeated(samples) => write!(f, "repeated samples: {samples}"),
            Self::AnotherActuation { at } => write!(f, "another actuation at sample {at}"),
            Self::UnsteadyStart { speed_rad_s } => write!(f, "unsteady start: off by {speed_rad_s:.1} rad/s"),
            Self::TimeJitter { of_period } => {
                write!(f, "numbered by time, which jitters by {:.1} %", 100.0 * of_period)
            }
        }
    }
}

impl fmt::Display for Invalidity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::CutShort(why) => write!(f, "cut short: {why}"),
            Self::ModeChanged => f.write_str("mode changed"),
            Self::CommandInGap { at } => write!(f, "gap: the command jumped in it, before sample {at}"),
            Self::TooManyFlawed { defect, count, longest } => {
                write!(f, "{defect}: {count} samples unusable, {longest} in a row")
            }
            Self::Stuck(signal) => write!(f, "stuck: {signal}"),
            Self::CounterJumped { counter, at } => write!(f, "counter jump: {counter} at sample {at}"),
            Self::Held { counter, samples } => write!(
                f,
                "repeated samples: the {counter} stands for {samples} samples at a time: leave what repeats out, with resample = true"
            ),
            Self::CountersDisagree { range_rad } => {
                write!(f, "counters disagree: resolver and encoder by {range_rad:.4} rad")
            }
            Self::StartInMotion { turned_rad } => {
                write!(
                    f,
                    "start in motion: the command moved before the trigger, and the motor by {turned_rad:.2} rad"
                )
            }
            Self::TimeJitter { of_period } => write!(
                f,
                "time jitter: numbered by time, which jitters by {:.1} %: the number of the row as sample.counter, with clock = \"receiver\" and \
                 the true sample_rate_hz, does without",
                100.0 * of_period
            ),
            Self::SampleRate {
                configured_hz,
                by_stamps_hz,
            } => write!(
                f,
                "sample rate: {configured_hz:.1} Hz configured (sample_rate_hz), {by_stamps_hz:.1} Hz arrive by the stamps"
            ),
        }
    }
}

impl fmt::Display for CutShort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::StreamEnded => "stream ended",
            Self::WentIdle => "went idle",
            Self::CounterWentBack => "sample counter went back",
            Self::RateChanged => "sample rate changed",
        })
    }
}

impl fmt::Display for Defect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Missing => "gap",
            Self::NotFinite => "current is no number",
            Self::BeyondScale => "current beyond full scale",
            Self::Clipped => "current at the end of its range (converter, or field of a frame: widen it)",
            Self::CurrentSum => "current sum",
            Self::MotorSpike => "resolver spikes",
            Self::OutputSpike => "encoder spikes",
            Self::CommandGlitch => "command glitches",
            Self::Repeated => "repeated samples",
        })
    }
}

impl fmt::Display for Signal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Currents => "currents",
            Self::Motor => "resolver",
            Self::Output => "encoder",
        })
    }
}

impl fmt::Display for Counter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Motor => "resolver",
            Self::Output => "encoder",
        })
    }
}

impl fmt::Display for WindowQuality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Complete => f.write_str("complete"),
            Self::Degraded(handicaps) => {
                for (n, handicap) in handicaps.iter().enumerate() {
                    write!(f, "{}{handicap}", if n > 0 { "; " } else { "" })?;
                }
                Ok(())
            }
            Self::Invalid(why) => why.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The texts that `docs/windows.md` lists.
    #[test]
    fn every_quality_is_told_in_the_words_of_the_page() {
        let (defect, count, longest) = (Defect::Missing, 30, 12);
        let invalid = [
            (Invalidity::CutShort(CutShort::StreamEnded), "cut short: stream ended"),
            (Invalidity::CutShort(CutShort::WentIdle), "cut short: went idle"),
            (
                Invalidity::CutShort(CutShort::CounterWentBack),
                "cut short: sample counter went back",
            ),
            (
                Invalidity::CutShort(CutShort::RateChanged),
                "cut short: sample rate changed",
            ),
            (Invalidity::ModeChanged, "mode changed"),
            (
                Invalidity::CommandInGap { at: 7 },
                "gap: the command jumped in it, before sample 7",
            ),
            (
                Invalidity::TooManyFlawed { defect, count, longest },
                "gap: 30 samples unusable, 12 in a row",
            ),
            (Invalidity::Stuck(Signal::Currents), "stuck: currents"),
            (Invalidity::Stuck(Signal::Motor), "stuck: resolver"),
            (Invalidity::Stuck(Signal::Output), "stuck: encoder"),
            (
                Invalidity::CounterJumped {
                    counter: Counter::Output,
                    at: 9,
                },
                "counter jump: encoder at sample 9",
            ),
            (
                Invalidity::CounterJumped {
                    counter: Counter::Motor,
                    at: 9,
                },
                "counter jump: resolver at sample 9",
            ),
            (
                Invalidity::Held {
                    counter: Counter::Output,
                    samples: 10,
                },
                "repeated samples: the encoder stands for 10 samples at a time: leave what repeats out, with resample = true",
            ),
            (
                Invalidity::CountersDisagree { range_rad: 0.05 },
                "counters disagree: resolver and encoder by 0.0500 rad",
            ),
            (
                Invalidity::StartInMotion { turned_rad: 0.25 },
                "start in motion: the command moved before the trigger, and the motor by 0.25 rad",
            ),
            (
                Invalidity::TimeJitter { of_period: 0.288 },
                "time jitter: numbered by time, which jitters by 28.8 %: the number of the row as sample.counter, with clock = \"receiver\" and \
                 the true sample_rate_hz, does without",
            ),
            (
                Invalidity::SampleRate {
                    configured_hz: 2000.0,
                    by_stamps_hz: 1000.04,
                },
                "sample rate: 2000.0 Hz configured (sample_rate_hz), 1000.0 Hz arrive by the stamps",
            ),
        ];
        for (why, expected) in invalid {
            let quality = WindowQuality::Invalid(why);
            assert_eq!((quality.to_string().as_str(), quality.is_fit()), (expected, false));
        }
        let handicaps = vec![
            Degradation::Filled { lost: 1, rejected: 2 },
            Degradation::Repeated(3),
            Degradation::AnotherActuation { at: 4 },
            Degradation::UnsteadyStart { speed_rad_s: 5.04 },
            Degradation::TimeJitter { of_period: 0.061 },
        ];
        let expected = "1 samples lost and 2 refused, filled; repeated samples: 3; another actuation at sample 4; \
                        unsteady start: off by 5.0 rad/s; numbered by time, which jitters by 6.1 %";
        let quality = WindowQuality::Degraded(handicaps);
        assert_eq!((quality.to_string().as_str(), quality.is_fit()), (expected, true));
        assert_eq!(WindowQuality::Complete.to_string(), "complete");
    }

    #[test]
    fn every_defect_has_its_own_words_and_its_place_among_all() {
        let words = Defect::ALL.map(|defect| defect.to_string());
        let expected = [
            "gap",
            "current is no number",
            "current beyond full scale",
            "current at the end of its range (converter, or field of a frame: widen it)",
            "current sum",
            "resolver spikes",
            "encoder spikes",
            "command glitches",
            "repeated samples",
        ];
        assert_eq!(words, expected);
        for (n, defect) in Defect::ALL.into_iter().enumerate() {
            assert_eq!(defect as usize, n, "counted by this number");
        }
    }
}

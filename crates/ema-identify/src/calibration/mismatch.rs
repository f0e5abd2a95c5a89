//! How wrong a calibrated monitor still is in windows of one sample rate, and what each signal weighs because of it.

use ema_models::{FAULT_COUNT, Form, SIGNAL_COUNT, Signals, Weights};

/// How wrong a calibrated monitor still is in windows of one sample rate.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "std",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields)
)]
pub struct Mismatch {
    /// Sample rate, Hz.
    pub sample_rate_hz: f64,
    /// Root-mean-square error of an estimate that the monitor's own mismatch causes, in fault coordinates
    /// `[k1…k5, ζ cos φ, ζ sin φ, k8]`.
    pub model_sigma: [f64; FAULT_COUNT],
    /// Root-mean-square residual at the true fault vector.
    pub residual_rms: SignalTable,
    /// Samples after which residuals of a signal are independent; a residual that drifts counts for less.
    pub correlation_samples: SignalTable,
}

impl Mismatch {
    /// Weight of each signal at a sample rate, Hz: residuals count by their size, and by how many of them are independent.
    ///
    /// Residuals drift for a time, not for a number of samples. The one-axis forms know no direct current.
    #[must_use]
    pub fn weights(&self, sample_rate: f64, form: Form) -> Weights {
        let (rms, correlation) = (
            Signals::from(self.residual_rms).to_array(),
            Signals::from(self.correlation_samples).to_array(),
        );
        let samples = correlation.map(|samples| (samples * sample_rate / self.sample_rate_hz).max(1.0));
        let weight: [f64; SIGNAL_COUNT] = core::array::from_fn(|s| 1.0 / (rms[s] * libm::sqrt(samples[s])));
        let mut weights = Signals::from_array(weight);
        if form != Form::ThreePhase {
            weights.i_d = 0.0;
        }
        weights
    }
}

/// Noise of a window's signals beside the mismatch of its monitor.
#[cfg(feature = "std")]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseBeside {
    /// Variance of errors that are independent from sample to sample.
    pub white: Signals<f64>,
    /// Variance of an error that is the same in all samples of a window.
    pub lasting: Signals<f64>,
}

#[cfg(feature = "std")]
impl Mismatch {
    /// The same of windows of so many samples at a sample rate, Hz, whose signals have this noise beside: with `r² c` of the mismatch, white and
    /// lasting variances w and l, and n samples, the residual is `√(r² + w + l)`, and `(r² c + w + l n)/(r² + w + l)` samples are as one.
    #[must_use]
    pub fn with_noise_beside(&self, noise: &NoiseBeside, sample_rate: f64, samples: usize) -> Self {
        let of = |table: SignalTable| Signals::from(table).to_array();
        let (mut rms, mut correlation) = (of(self.residual_rms), of(self.correlation_samples));
        let (white, lasting) = (noise.white.to_array(), noise.lasting.to_array());
        for s in 0..SIGNAL_COUNT {
            let own = rms[s] * rms[s];
            let whole = own + white[s] + lasting[s];
            let correlated = (correlation[s] * sample_rate / self.sample_rate_hz).max(1.0);
            correlation[s] = (own * correlated + white[s] + lasting[s] * samples as f64) / whole;
            rms[s] = libm::sqrt(whole);
        }
        Self {
            sample_rate_hz: sample_rate,
            residual_rms: Signals::from_array(rms).into(),
            correlation_samples: Signals::from_array(correlation).into(),
            ..*self
        }
    }
}

/// One number per compared signal.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "std",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields)
)]
pub struct SignalTable {
    /// Direct current (residuals: A).
    pub i_d: f64,
    /// Quadrature current (A).
    pub i_q: f64,
    /// Motor angle (rad).
    pub theta_m: f64,
    /// Motor speed (rad/s).
    pub omega_m: f64,
    /// Output angle (rad).
    pub theta_out: f64,
}

impl From<Signals<f64>> for SignalTable {
    fn from(s: Signals<f64>) -> Self {
        Self {
            i_d: s.i_d,
            i_q: s.i_q,
            theta_m: s.theta_m,
            omega_m: s.omega_m,
            theta_out: s.theta_out,
        }
    }
}

impl From<SignalTable> for Signals<f64> {
    fn from(s: SignalTable) -> Self {
        Self {
            i_d: s.i_d,
            i_q: s.i_q,
            theta_m: s.theta_m,
            omega_m: s.omega_m,
            theta_out: s.theta_out,
        }
    }
}

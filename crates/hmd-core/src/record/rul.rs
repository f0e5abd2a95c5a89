//! Remaining useful life.

use super::schema::message;
use ema_models::FaultId;

message! {
    /// Remaining useful life of one actuator after one window; the quantiles are absent until there is a trend.
    pub struct Rul {
        /// Actuator name, as in the topic.
        actuator: String = 1 string;
        /// Number of the window after which this was predicted.
        window: u64 = 2 uint64;
        /// Start of that window, UTC ns.
        t_start_ns: u64 = 3 uint64;
        /// Operating hours so far.
        operating_h: Option<f64> = 4 double optional;
        /// Actuation cycles so far.
        operating_cycles: Option<f64> = 5 double optional;
        /// Operating hours left, 10 % quantile.
        rul_p10_h: Option<f64> = 6 double optional;
        /// Operating hours left, median.
        rul_p50_h: Option<f64> = 7 double optional;
        /// Operating hours left, 90 % quantile.
        rul_p90_h: Option<f64> = 8 double optional;
        /// Cycles left, 10 % quantile.
        rul_p10_cycles: Option<f64> = 9 double optional;
        /// Cycles left, median.
        rul_p50_cycles: Option<f64> = 10 double optional;
        /// Cycles left, 90 % quantile.
        rul_p90_cycles: Option<f64> = 11 double optional;
        /// The fault whose trend ends the life first; without a trend the largest detected one, or empty.
        dominant_fault: String = 12 string;
        /// Why there is no number yet; else empty.
        reason: String = 13 string;
        /// Motor work done so far, J.
        operating_work_j: Option<f64> = 14 double optional;
        /// Probability that the life ends within `horizon_h` operating hours.
        failure_probability: Option<f64> = 15 double optional;
        /// Operating hours of `failure_probability`.
        horizon_h: Option<f64> = 16 double optional;
        /// What ends the life: `damage`, or the requirement of the specification that is missed first, `slew_rate`,
        /// `response_time`, `steady_error` or `stall`; empty without a number.
        governed_by: String = 17 string;
        /// What a maintenance event replaced since the window before: `unit`, or `motor`, `gearbox`, `controller`, joined by
        /// commas; else empty.
        replaced: String = 18 string;
        /// What counts as hours: `operating` or `elapsed` time. Empty in records of older versions.
        hours_of: String = 19 string;
        /// Hours left to the end of life by friction alone, 10 % quantile; absent without a trend, as all below.
        friction_p10_h: Option<f64> = 21 double optional;
        /// Median.
        friction_p50_h: Option<f64> = 22 double optional;
        /// 90 % quantile.
        friction_p90_h: Option<f64> = 23 double optional;
        /// Probability of that end within `horizon_h`.
        friction_failure_probability: Option<f64> = 24 double optional;
        /// By backlash, 10 % quantile.
        backlash_p10_h: Option<f64> = 25 double optional;
        /// Median.
        backlash_p50_h: Option<f64> = 26 double optional;
        /// 90 % quantile.
        backlash_p90_h: Option<f64> = 27 double optional;
        /// Probability within `horizon_h`.
        backlash_failure_probability: Option<f64> = 28 double optional;
        /// By a short circuit of phase A, 10 % quantile.
        short_a_p10_h: Option<f64> = 29 double optional;
        /// Median.
        short_a_p50_h: Option<f64> = 30 double optional;
        /// 90 % quantile.
        short_a_p90_h: Option<f64> = 31 double optional;
        /// Probability within `horizon_h`.
        short_a_failure_probability: Option<f64> = 32 double optional;
        /// By a short circuit of phase B, 10 % quantile.
        short_b_p10_h: Option<f64> = 33 double optional;
        /// Median.
        short_b_p50_h: Option<f64> = 34 double optional;
        /// 90 % quantile.
        short_b_p90_h: Option<f64> = 35 double optional;
        /// Probability within `horizon_h`.
        short_b_failure_probability: Option<f64> = 36 double optional;
        /// By a short circuit of phase C, 10 % quantile.
        short_c_p10_h: Option<f64> = 37 double optional;
        /// Median.
        short_c_p50_h: Option<f64> = 38 double optional;
        /// 90 % quantile.
        short_c_p90_h: Option<f64> = 39 double optional;
        /// Probability within `horizon_h`.
        short_c_failure_probability: Option<f64> = 40 double optional;
        /// By eccentricity, 10 % quantile.
        eccentricity_p10_h: Option<f64> = 41 double optional;
        /// Median.
        eccentricity_p50_h: Option<f64> = 42 double optional;
        /// 90 % quantile.
        eccentricity_p90_h: Option<f64> = 43 double optional;
        /// Probability within `horizon_h`.
        eccentricity_failure_probability: Option<f64> = 44 double optional;
        /// By a changed gain, 10 % quantile.
        gain_p10_h: Option<f64> = 45 double optional;
        /// Median.
        gain_p50_h: Option<f64> = 46 double optional;
        /// 90 % quantile.
        gain_p90_h: Option<f64> = 47 double optional;
        /// Probability within `horizon_h`.
        gain_failure_probability: Option<f64> = 48 double optional;
    }
}

super::impl_record!(Rul, |rul| format!("/{}/rul", rul.actuator));

impl Rul {
    /// Fills what is left to each fault, in the order of [`FaultId::ALL`]: quantiles in hours, and the probability of
    /// the end within the horizon.
    pub fn set_faults(&mut self, faults: [Option<([f64; 3], f64)>; FaultId::COUNT]) {
        macro_rules! set {
            ($fault:expr, $p10:ident, $p50:ident, $p90:ident, $probability:ident) => {
                let quantile = |n: usize| $fault.and_then(|(hours, _)| super::finite(hours[n]));
                (self.$p10, self.$p50, self.$p90) = (quantile(0), quantile(1), quantile(2));
                self.$probability = $fault.and_then(|(_, probability)| super::finite(probability));
            };
        }
        let [friction, backlash, short_a, short_b, short_c, eccentricity, gain] = faults;
        set!(
            friction,
            friction_p10_h,
            friction_p50_h,
            friction_p90_h,
            friction_failure_probability
        );
        set!(
            backlash,
            backlash_p10_h,
            backlash_p50_h,
            backlash_p90_h,
            backlash_failure_probability
        );
        set!(
            short_a,
            short_a_p10_h,
            short_a_p50_h,
            short_a_p90_h,
            short_a_failure_probability
        );
        set!(
            short_b,
            short_b_p10_h,
            short_b_p50_h,
            short_b_p90_h,
            short_b_failure_probability
        );
        set!(
            short_c,
            short_c_p10_h,
            short_c_p50_h,
            short_c_p90_h,
            short_c_failure_probability
        );
        set!(
            eccentricity,
            eccentricity_p10_h,
            eccentricity_p50_h,
            eccentricity_p90_h,
            eccentricity_failure_probability
        );
        set!(gain, gain_p10_h, gain_p50_h, gain_p90_h, gain_failure_probability);
    }

    /// Hours left to each fault alone, in the order of [`FaultId::ALL`]: quantiles 10, 50 and 90 %.
    #[must_use]
    pub fn faults(&self) -> [Option<[f64; 3]>; FaultId::COUNT] {
        [
            (self.friction_p10_h, self.friction_p50_h, self.friction_p90_h),
            (self.backlash_p10_h, self.backlash_p50_h, self.backlash_p90_h),
            (self.short_a_p10_h, self.short_a_p50_h, self.short_a_p90_h),
            (self.short_b_p10_h, self.short_b_p50_h, self.short_b_p90_h),
            (self.short_c_p10_h, self.short_c_p50_h, self.short_c_p90_h),
            (
                self.eccentricity_p10_h,
                self.eccentricity_p50_h,
                self.eccentricity_p90_h,
            ),
            (self.gain_p10_h, self.gain_p50_h, self.gain_p90_h),
        ]
        .map(|(p10, p50, p90)| Some([p10?, p50?, p90?]))
    }

    /// Probability of the end by each fault alone within the horizon, in the order of [`FaultId::ALL`].
    fn probabilities(&self) -> [Option<f64>; FaultId::COUNT] {
        [
            self.friction_failure_probability,
            self.backlash_failure_probability,
            self.short_a_failure_probability,
            self.short_b_failure_probability,
            self.short_c_failure_probability,
            self.eccentricity_failure_probability,
            self.gain_failure_probability,
        ]
    }

    /// Forgets what is left to faults whose part was replaced since. Where that took away what ends the life (`is_end_new`), the earliest end of the
    /// others does.
    pub(crate) fn forget(&mut self, is_new: impl Fn(FaultId) -> bool, is_end_new: bool) {
        let (hours, probabilities) = (self.faults(), self.probabilities());
        let left = FaultId::ALL.map(|fault| {
            let hours = hours[fault.index()].filter(|_| !is_new(fault))?;
            Some((hours, probabilities[fault.index()].unwrap_or(f64::NAN)))
        });
        self.set_faults(left);
        if !is_end_new {
            return;
        }
        let ends = FaultId::ALL.into_iter().zip(left);
        let first = ends
            .filter_map(|(fault, left)| left.map(|(hours, _)| (fault, hours)))
            .min_by(|a, b| a.1[0].total_cmp(&b.1[0]));
        let hours = first.map(|(_, hours)| hours);
        (self.rul_p10_h, self.rul_p50_h, self.rul_p90_h) =
            (hours.map(|h| h[0]), hours.map(|h| h[1]), hours.map(|h| h[2]));
        (self.rul_p10_cycles, self.rul_p50_cycles, self.rul_p90_cycles) = (None, None, None);
        self.failure_probability = first.and_then(|(fault, _)| probabilities[fault.index()]);
        self.dominant_fault = first.map_or_else(String::new, |(fault, _)| fault.name().to_owned());
        self.governed_by = first.map_or_else(String::new, |_| "damage".to_owned());
        if first.is_none() {
            self.horizon_h = None;
        }
    }
}

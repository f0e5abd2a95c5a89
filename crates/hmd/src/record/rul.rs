//! Remaining useful life.

use super::schema::message;

message! {
    /// Remaining useful life of one actuator after one window; the quantiles are absent until there is a trend.
    pub struct Rul {
        /// Actuator name, as in the topic.
        actuator: String = 1 string;
        /// Number of the window after which this was said.
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
        /// The fault whose trend ends the life first; empty when there is none.
        dominant_fault: String = 12 string;
        /// Why there is no number yet; else empty.
        reason: String = 13 string;
    }
}

super::impl_record!(Rul, |rul| format!("/{}/rul", rul.actuator));

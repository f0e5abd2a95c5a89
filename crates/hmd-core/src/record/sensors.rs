//! Health of an actuator's sensors after one window.

use super::finite;
use super::schema::message;
use crate::health::HealthState;
use crate::sensor_health::{SENSOR_QUANTITY_COUNT, SensorState};

message! {
    /// Health of the sensors of one actuator after one window. It raises no fault of a part.
    pub struct Sensors {
        /// Actuator name, as in the topic.
        actuator: String = 1 string;
        /// Number of the window.
        window: u64 = 2 uint64;
        /// Start of the window, UTC ns.
        t_start_ns: u64 = 3 uint64;
        /// Worst level of all quantities: `nominal`, `watch`, `warning`, `critical` or `unknown`.
        level: String = 4 string;
        /// Quantities at `watch` or worse.
        drifting: Vec<String> = 5 string repeated;
        /// Each quantity.
        quantities: Vec<SensorReading> = 6 message repeated SensorReading;
    }
}

message! {
    /// One quantity of the sensors.
    pub struct SensorReading {
        /// Name, with its unit last.
        quantity: String = 1 string;
        /// Value in the window; absent where the window does not show it.
        value: Option<f64> = 2 double optional;
        /// Standard deviation of the value.
        sigma: Option<f64> = 3 double optional;
        /// Difference from the reference; absent while there is none.
        drift: Option<f64> = 4 double optional;
        /// Standard deviation of the drift, with the scatter of the reference.
        drift_sigma: Option<f64> = 5 double optional;
        /// Growth of the drift per operating hour; absent without a trend.
        trend_per_h: Option<f64> = 6 double optional;
        /// Standard deviation of the growth.
        trend_per_h_sigma: Option<f64> = 7 double optional;
        /// Level of the drift: `nominal`, `watch`, `warning`, `critical` or `unknown`.
        level: String = 8 string;
    }
}

super::impl_record!(Sensors, |sensors| format!("/{}/sensors", sensors.actuator));

impl Sensors {
    /// Fills levels and quantities.
    pub fn set_states(&mut self, states: &[SensorState; SENSOR_QUANTITY_COUNT]) {
        let worst = states.iter().map(|state| state.level).max();
        worst.unwrap_or_default().name().clone_into(&mut self.level);
        let drifting = states.iter().filter(|state| state.level >= HealthState::Watch);
        self.drifting = drifting.map(|state| state.quantity.name().to_owned()).collect();
        let pair = |pair: Option<(f64, f64)>| {
            pair.and_then(|(value, sigma)| Some((finite(value)?, finite(sigma)?)))
                .unzip()
        };
        self.quantities = states
            .iter()
            .map(|state| {
                let ((value, sigma), (drift, drift_sigma)) = (pair(state.value), pair(state.drift));
                let (trend_per_h, trend_per_h_sigma) = pair(state.trend_per_h);
                SensorReading {
                    quantity: state.quantity.name().to_owned(),
                    value,
                    sigma,
                    drift,
                    drift_sigma,
                    trend_per_h,
                    trend_per_h_sigma,
                    level: state.level.name().to_owned(),
                }
            })
            .collect();
    }
}

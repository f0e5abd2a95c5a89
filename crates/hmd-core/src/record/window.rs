//! One actuation window: what was seen and what the best fit makes of it.

use super::schema::message;

message! {
    /// The samples of one actuation and the fit to them, so that plots can be made from the record alone.
    pub struct Window {
        /// Actuator name, as in the topic.
        actuator: String = 1 string;
        /// Number of the window, judged or not, from 0.
        window: u64 = 2 uint64;
        /// Start of the window, UTC ns.
        t_start_ns: u64 = 3 uint64;
        /// Length of the window, s.
        duration_s: f64 = 4 double;
        /// `ok`, `degraded`, `invalid` or `unmodelled`.
        status: String = 5 string;
        /// Why the status is not `ok`; else empty.
        reason: String = 6 string;
        /// Samples received.
        samples: u64 = 7 uint64;
        /// Samples that the rate and the length call for.
        samples_expected: u64 = 8 uint64;
        /// Samples missing by their counters.
        samples_lost: u64 = 9 uint64;
        /// Sampling rate, Hz.
        sample_rate_hz: f64 = 10 double;
        /// `idle`, `position` or `speed`.
        mode: String = 11 string;
        /// Setpoint before the actuation: rad at the output shaft or rad/s at the motor shaft, by `mode`.
        setpoint_start: Option<f64> = 12 double optional;
        /// Setpoint at the end of the window, same unit.
        setpoint_end: Option<f64> = 13 double optional;
        /// Smallest setpoint, same unit.
        setpoint_min: Option<f64> = 14 double optional;
        /// Largest setpoint, same unit.
        setpoint_max: Option<f64> = 15 double optional;
        /// Angle of the output shaft at the end of the window less that at its start, rad.
        travel_rad: Option<f64> = 16 double optional;
        /// Largest magnitude of the measured motor speed, rad/s; absent when the window was not identified.
        peak_speed_rad_s: Option<f64> = 17 double optional;
        /// Largest magnitude of the measured i_q, A; absent when the window was not identified.
        peak_i_q_a: Option<f64> = 18 double optional;
        /// DC link voltage as last reported when the window ended, V.
        dc_link_v: Option<f64> = 19 double optional;
        /// Winding temperature, the same, °C.
        winding_temp_c: Option<f64> = 20 double optional;
        /// Load torque at the output, the same, Nm; positive when it opposes positive motion.
        load_torque_nm: Option<f64> = 21 double optional;
        /// Time of each stored sample from the start of the window, s. All arrays below have this length or none.
        time_s: Vec<f32> = 30 float repeated;
        /// Setpoint, unit by `mode`.
        setpoint: Vec<f32> = 31 float repeated;
        /// Measured quadrature current, A.
        measured_i_q_a: Vec<f32> = 32 float repeated;
        /// Fitted quadrature current, A.
        fitted_i_q_a: Vec<f32> = 33 float repeated;
        /// Measured motor speed, rad/s.
        measured_speed_rad_s: Vec<f32> = 34 float repeated;
        /// Fitted motor speed, rad/s.
        fitted_speed_rad_s: Vec<f32> = 35 float repeated;
        /// Measured position of the output shaft, rad.
        measured_position_rad: Vec<f32> = 36 float repeated;
        /// Fitted position of the output shaft, rad.
        fitted_position_rad: Vec<f32> = 37 float repeated;
    }
}

super::impl_record!(Window, |window| format!("/{}/window", window.actuator));

//! What comes with the samples of an actuator: their rate, and the conditions that its status frames report.

use ema_wire::can::Status;
use ema_wire::quantity;

/// The rate of an actuator's samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleRate {
    /// Samples per second.
    pub hz: f64,
    /// Share that it may be off by, as far as it was measured.
    pub uncertainty: f64,
    /// Whether it was measured by the device's own time; otherwise it is the nominal rate.
    pub is_measured: bool,
}

impl SampleRate {
    /// The nominal rate, where the device's time shows none.
    pub(crate) fn nominal(hz: f64) -> Self {
        Self {
            hz,
            uncertainty: 0.0,
            is_measured: false,
        }
    }
}

/// Operating conditions as last reported by status frames; `None` where a device does not report one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeasuredConditions {
    /// DC link voltage, V.
    pub dc_link_v: Option<f64>,
    /// Winding temperature, °C.
    pub winding_temp_deg_c: Option<f64>,
    /// Load torque at the output, Nm.
    pub load_torque_nm: Option<f64>,
}

impl From<&Status> for MeasuredConditions {
    fn from(status: &Status) -> Self {
        Self {
            dc_link_v: (status.dc_link_dv > 0).then(|| quantity::dc_link_v(status.dc_link_dv)),
            winding_temp_deg_c: (status.winding_temp_dc != Status::NO_TEMPERATURE)
                .then(|| quantity::winding_temp_deg_c(status.winding_temp_dc)),
            load_torque_nm: status.load_torque_dnm.map(quantity::load_torque_nm),
        }
    }
}

//! The window of one simulated actuation, cut from its frames as the daemon does.

use std::sync::Arc;

use ema_models::reference::Scenario;
use hmd_core::config::Config;
use hmd_core::frame::{BusError, BusNames};
use hmd_core::outbox::WindowJob;
use hmd_core::pipeline::Pipeline;
use hmd_lab::simulate::{EPOCH_NS, traffic};

/// The first window of a scenario of the configuration's first actuator; `None` where none is cut.
pub(crate) fn window_of(config: &Arc<Config>, scenario: &Scenario) -> Result<Option<WindowJob>, BusError> {
    let mut names = BusNames::new();
    names.intern("can0")?;
    let mut pipeline = Pipeline::new(config.clone());
    for frame in traffic(scenario, config.actuators()[0].id, EPOCH_NS) {
        pipeline.push(&frame, &names);
    }
    pipeline.finish();
    Ok(pipeline.take_windows().into_iter().next())
}

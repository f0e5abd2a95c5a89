//! What the motion of a window says of quantities that are also read, each without its own reading.

/// A quantity without its reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inferred {
    /// Its value.
    pub value: f64,
    /// One standard deviation.
    pub sigma: f64,
}

/// The quantities of one window; `None` where the estimator does not infer them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct InferredReadings {
    /// Constant load at the output, Nm; positive opposes positive motion.
    pub load_torque: Option<Inferred>,
    /// The same where friction is not worn, and where it is worn to its limit: between the two lies the load of a motion that does not tell
    /// load from friction. Of commissioned units none: errors of what their windows share move the load of such a motion by twice its
    /// friction (`servo28`, 400 Hz).
    pub load_by_friction: Option<[Inferred; 2]>,
    /// DC link voltage, V.
    pub dc_link: Option<Inferred>,
    /// Torque for each read current of phase A, B, C, relative to that of the commissioned unit, where the window shows it.
    pub turns: [Option<Inferred>; 3],
    /// Friction relative to that of the commissioned unit.
    pub friction: Option<Inferred>,
}

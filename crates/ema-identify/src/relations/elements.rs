//! What the relations read off a window, one number per element of the actuator, and what a window needs to show it.

use ema_models::FaultId;

/// A quantity that a relation reads off a window, and whose change is damage.
///
/// The order is that of the fault coordinates `[k1…k5, ζ cos φ_e, ζ sin φ_e, k8]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// Dry friction relative to that of the commissioned unit.
    Friction,
    /// Width of the play at the output, rad.
    Backlash,
    /// Intact turns N_A.
    TurnsA,
    /// Intact turns N_B.
    TurnsB,
    /// Intact turns N_C.
    TurnsC,
    /// `ζ cos φ_e`.
    EccentricityCos,
    /// `ζ sin φ_e`.
    EccentricitySin,
    /// Position gain relative to that of the type.
    Gain,
}

/// Number of elements.
pub const ELEMENT_COUNT: usize = 8;

impl Element {
    /// All elements in order.
    pub const ALL: [Self; ELEMENT_COUNT] = [
        Self::Friction,
        Self::Backlash,
        Self::TurnsA,
        Self::TurnsB,
        Self::TurnsC,
        Self::EccentricityCos,
        Self::EccentricitySin,
        Self::Gain,
    ];

    /// The elements of the torque balance, in the order of its free coefficients.
    pub const BALANCE: [Self; 6] = [
        Self::TurnsA,
        Self::TurnsB,
        Self::TurnsC,
        Self::EccentricityCos,
        Self::EccentricitySin,
        Self::Friction,
    ];

    /// The fault that shows in this element.
    #[must_use]
    pub fn fault(self) -> FaultId {
        match self {
            Self::Friction => FaultId::Friction,
            Self::Backlash => FaultId::Backlash,
            Self::TurnsA => FaultId::ShortA,
            Self::TurnsB => FaultId::ShortB,
            Self::TurnsC => FaultId::ShortC,
            Self::EccentricityCos | Self::EccentricitySin => FaultId::Eccentricity,
            Self::Gain => FaultId::Gain,
        }
    }
}

/// What a window would have needed to show an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needed {
    /// More samples with the motor at 3 rad/s or more.
    LongerMotion,
    /// Motion in both directions: in one direction a load looks like friction.
    BothDirections,
    /// More current, so that the phases' torques stand out of the residual.
    MoreCurrent,
    /// A reversal of the output through the play.
    Reversal,
    /// A reversal of the output where no load holds it at one flank: a worn play would look like a healthy one.
    OpenReversal,
    /// Position mode; elsewhere the position gain has no effect.
    PositionMode,
    /// More samples with neither speed nor torque at their limits, while the position error changes.
    UnsaturatedControl,
    /// A play that the load behind a compliant transmission does not leave the motor in.
    NarrowPlay,
    /// Commissioning windows that show the element: at least two.
    CommissioningThatShowsIt,
}

/// A number with its standard deviation, in the element's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// The number.
    pub value: f64,
    /// One standard deviation.
    pub sigma: f64,
}

/// Readings of all elements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ElementReadings([Result<Reading, Needed>; ELEMENT_COUNT]);

impl ElementReadings {
    /// No element read.
    pub(super) fn none() -> Self {
        Self([Err(Needed::LongerMotion); ELEMENT_COUNT])
    }

    pub(super) fn get(&self, element: Element) -> Result<Reading, Needed> {
        self.0[element as usize]
    }

    pub(super) fn set(&mut self, element: Element, reading: Reading) {
        self.put(element, Ok(reading));
    }

    /// Puts what another relation reads.
    pub(super) fn put(&mut self, element: Element, reading: Result<Reading, Needed>) {
        self.0[element as usize] = reading;
    }

    pub(super) fn fail(&mut self, elements: impl IntoIterator<Item = Element>, needed: Needed) {
        for element in elements {
            self.0[element as usize] = Err(needed);
        }
    }
}

//! Inputs of live sources to the pipeline, and the one bounded queue between them.
//!
//! A source is one task on the I/O runtime that turns one bus into [`Input`]s and sends them, in the order of the bus,
//! through its [`Feed`]. It retries without limit: what is missing or fails is reported once as a [`LinkState`] and tried again after
//! a bounded pause ([`RetryDelay`](hmd_storage::retry_delay::RetryDelay)), until the feed closes.

use std::fmt;
use std::time::Duration;

use tokio::sync::{mpsc, watch};

use ema_wire::ActuatorId;
use hmd_core::frame::RawFrame;
use hmd_storage::clock::now_ns;

/// Inputs that wait for the pipeline: 2.7 s of three full buses of 1 Mbit/s, about 6 MB.
///
/// Policy when it is full: the sources wait, so that frames queue up in the sockets; what the kernel must then drop, it
/// counts, and the source reports it as [`Input::Lost`]. Nothing is ever dropped here.
pub const QUEUE_INPUTS: usize = 1 << 16;

/// Longest pause before a link that is missing or down is tried again: it bounds how late its return is noticed.
pub(crate) const REOPENED_WITHIN: Duration = Duration::from_millis(250);

/// How long an emptied socket or terminal is left to fill, so that one wake-up serves many frames. Buffers hold some ten
/// times as much and more.
pub(crate) const COALESCE: Duration = Duration::from_millis(2);

/// One thing that happened on a bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Input {
    /// A frame was received.
    Frame(RawFrame),
    /// The link came or went.
    Link {
        /// Index of the bus.
        bus: u16,
        /// UTC, ns.
        stamp_ns: u64,
        /// What it is now.
        state: LinkState,
        /// Error of the operating system, if any.
        cause: Option<Box<str>>,
    },
    /// Data were lost before they became frames.
    Lost {
        /// Index of the bus.
        bus: u16,
        /// How.
        loss: LiveLoss,
        /// How many frames.
        frames: u64,
    },
    /// A number that is not watched on this bus talks there; its frames are left out.
    Unwatched {
        /// Index of the bus.
        bus: u16,
        /// The number.
        number: ActuatorId,
    },
    /// Time goes on; sent by the driver, and by a playback with a clock of its own.
    Tick {
        /// UTC, ns.
        stamp_ns: u64,
    },
}

/// Whether a link can bring frames at all; what the frames say about the bus is another matter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkState {
    /// There is no such interface or device.
    Missing,
    /// It is there and switched off, or fails.
    Down,
    /// Frames can come.
    Up,
}

impl fmt::Display for LinkState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Missing => "missing",
            Self::Down => "down",
            Self::Up => "up",
        })
    }
}

/// How data were lost before they became frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LiveLoss {
    /// The receive queue of the socket was full.
    SocketQueue,
    /// Something was received that no bus can have carried.
    Unreadable,
}

impl fmt::Display for LiveLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::SocketQueue => "the receive queue was full",
            Self::Unreadable => "they cannot be read",
        })
    }
}

/// State of a link as last reported, so that each change is reported once.
#[derive(Debug, Default)]
pub(crate) struct Link {
    state: Option<LinkState>,
}

impl Link {
    /// Whether frames can come, by the last report.
    pub(crate) fn is_up(&self) -> bool {
        self.state == Some(LinkState::Up)
    }

    /// Reports the state of the link, unless it is unchanged.
    pub(crate) async fn change(&mut self, feed: &Feed, state: LinkState, cause: Option<&str>) -> Result<(), Closed> {
        if self.state == Some(state) {
            return Ok(());
        }
        self.state = Some(state);
        feed.link(state, cause).await
    }
}

/// The pipeline has ended; nothing takes inputs any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the pipeline has ended")]
pub struct Closed;

/// One source's end of the queue.
#[derive(Clone, Debug)]
pub struct Feed {
    bus: u16,
    queue: mpsc::Sender<Input>,
    closing: watch::Receiver<bool>,
}

impl Feed {
    /// For the bus with this index; the source ends soon after `closing` turns true.
    #[must_use]
    pub fn new(bus: u16, queue: mpsc::Sender<Input>, closing: watch::Receiver<bool>) -> Self {
        Self { bus, queue, closing }
    }

    /// Index of the bus, for the frames.
    #[must_use]
    pub fn bus(&self) -> u16 {
        self.bus
    }

    /// Sends a frame; waits while the queue is full.
    ///
    /// # Errors
    /// [`Closed`].
    pub async fn frame(&self, frame: RawFrame) -> Result<(), Closed> {
        self.send(Input::Frame(frame)).await
    }

    pub(crate) async fn send(&self, input: Input) -> Result<(), Closed> {
        self.queue.send(input).await.map_err(|_| Closed)
    }

    /// Reports that the link came or went, now.
    ///
    /// # Errors
    /// [`Closed`].
    pub async fn link(&self, state: LinkState, cause: Option<&str>) -> Result<(), Closed> {
        let (bus, stamp_ns) = (self.bus, now_ns());
        let cause = cause.map(Box::from);
        let input = Input::Link {
            bus,
            stamp_ns,
            state,
            cause,
        };
        self.send(input).await
    }

    /// Reports that frames were lost.
    ///
    /// # Errors
    /// [`Closed`].
    pub async fn lost(&self, loss: LiveLoss, frames: u64) -> Result<(), Closed> {
        let bus = self.bus;
        self.send(Input::Lost { bus, loss, frames }).await
    }

    /// Resolves when the source shall end. Cancel-safe: made for `select!` beside the wait for data.
    pub async fn closing(&mut self) {
        // An error means that the other end is gone.
        let _ = self.closing.wait_for(|closing| *closing).await;
    }
}

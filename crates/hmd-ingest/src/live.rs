//! Any live source, by its kind.

use crate::can::CanSource;
use crate::feed::{Feed, Input};
use crate::serial::SerialSource;

/// A source of frames that goes on until it is told to end.
pub enum LiveSource {
    /// A SocketCAN interface.
    Can(CanSource),
    /// A serial line.
    Serial(SerialSource),
    /// What lies in memory or is made on the way, as fast as it is taken; ends with the last. Frames are of this bus
    /// whatever they say; ticks are those of another clock, beside the driver's own.
    Playback(Box<dyn Iterator<Item = Input> + Send>),
}

impl LiveSource {
    /// Receives until the feed closes; only a playback ends by itself.
    pub async fn run(self, feed: Feed) {
        match self {
            Self::Can(source) => source.run(feed).await,
            Self::Serial(source) => source.run(feed).await,
            Self::Playback(inputs) => {
                for input in inputs {
                    let sent = match input {
                        Input::Frame(frame) => feed.frame(frame.with_bus(feed.bus())).await,
                        other => feed.send(other).await,
                    };
                    if sent.is_err() {
                        return;
                    }
                }
            }
        }
    }
}

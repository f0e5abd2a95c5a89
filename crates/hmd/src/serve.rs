//! Records for viewers, as they are written: the Foxglove WebSocket protocol, on this computer alone.
//!
//! A [`Hub`] observes the recorder and holds a bounded queue for each client; [`listen`] serves it on a thread of its own. The
//! recorder hands a record over and goes on: no client makes it wait, and what a slow client misses is counted and reported to it.

mod hub;
mod listen;
mod protocol;

pub use hub::Hub;
pub use listen::listen;
pub use protocol::SUBPROTOCOLS;

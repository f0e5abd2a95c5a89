//! A SocketCAN interface as a source of frames. Receive only: nothing here sends, and the socket is private.
//!
//! The interface may be missing at the start, go away, be switched off and come back: the source reports it and goes on.
//! A socket outlives `ip link set … down` and `up`, so it is kept, and frames are received from the first one on; an
//! interface that was deleted and made again needs a new socket.

mod receive;
mod stamp;
mod unwatched;

use std::collections::BTreeSet;
use std::io;

use ::socketcan::{CanFdSocket, CanFilter, Socket, SocketOptions};
use ema_wire::ActuatorId;
use ema_wire::can::Message;
use nix::errno::Errno;
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;

use super::feed::{COALESCE, Closed, Feed, Input, Link, LinkState, LiveLoss, QUEUE_INPUTS, REOPENED_WITHIN};
use hmd_core::config::Config;
use hmd_core::frame::{MAX_EXTENDED_ID, MAX_STANDARD_ID, socketcan};
use hmd_storage::clock::now_ns;
use hmd_storage::retry_delay::RetryDelay;
use receive::{Received, Receiver};
use unwatched::{Heard, Unwatched};

/// Frames taken from a socket before other tasks get their turn.
const BATCH: usize = 256;

/// One interface, and which of its frames are wanted.
#[derive(Clone, Debug)]
pub struct CanSource {
    interface: String,
    wanted: Wanted,
}

/// Which frames of an interface are wanted. Error frames always are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// All of them.
    All,
    /// Data frames with these identifiers; the kernel drops the others before they reach the queue.
    Ids {
        /// The identifiers.
        ids: BTreeSet<CanId>,
        /// Whether one of the built-in dictionary is watched: then the status of any number passes, too, and shows that another one talks.
        has_dictionary: bool,
    },
}

/// Identifier of a data frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CanId {
    /// The number.
    pub id: u32,
    /// Whether it has 29 bits.
    pub extended: bool,
}

impl CanId {
    /// Of the built-in dictionary.
    fn of_dictionary(id: u16) -> Self {
        Self {
            id: u32::from(id),
            extended: false,
        }
    }

    /// The number whose status it is, by the built-in dictionary.
    fn status_of(self) -> Option<ActuatorId> {
        let id = u16::try_from(self.id).ok().filter(|_| !self.extended)?;
        Message::from_id(id).and_then(|(number, message)| (message == Message::Status).then_some(number))
    }
}

impl Wanted {
    /// Frames of the actuators that a configuration has on an interface: those of its map, or of the built-in dictionary. Beside a drive
    /// all of them: its master may map PDO to any identifier, and commands come from any source.
    #[must_use]
    pub fn for_interface(config: &Config, interface: &str) -> Self {
        let (mut ids, mut has_dictionary) = (BTreeSet::new(), false);
        for actuator in config.actuators().iter().filter(|of| of.is_at(interface, of.id)) {
            if actuator.drive_bus.is_some() {
                return Self::All;
            }
            match &actuator.map {
                Some(map) => ids.extend(map.messages.iter().map(|of| CanId {
                    id: of.id,
                    extended: of.extended,
                })),
                None => {
                    has_dictionary = true;
                    ids.extend(Message::ALL.map(|message| CanId::of_dictionary(message.id(actuator.id))));
                }
            }
        }
        Self::Ids { ids, has_dictionary }
    }

    /// What the kernel lets pass; `None` is everything, which it is for more identifiers than it takes.
    fn let_pass(&self) -> Option<BTreeSet<CanId>> {
        let Self::Ids { ids, has_dictionary } = self else {
            return None;
        };
        let mut all = ids.clone();
        if *has_dictionary {
            all.extend(ActuatorId::all().map(|number| CanId::of_dictionary(Message::Status.id(number))));
        }
        (all.len() <= FILTERS_MAX).then_some(all)
    }
}

/// Why a socket is not read any more.
enum Ended {
    Closing,
    Failed(io::Error),
}

impl CanSource {
    /// A source for `interface`.
    #[must_use]
    pub fn new(interface: &str, wanted: Wanted) -> Self {
        Self {
            interface: interface.to_owned(),
            wanted,
        }
    }

    /// Receives until the feed closes.
    pub async fn run(self, mut feed: Feed) {
        let mut pause = RetryDelay::up_to(REOPENED_WITHIN);
        let mut link = Link::default();
        loop {
            let ended = match self.open() {
                Ok(receiver) => self.read(receiver, &mut feed, &mut link, &mut pause).await,
                Err(error) => Ended::Failed(error),
            };
            let Ended::Failed(error) = ended else { return };
            let state = if Errno::from_raw(error.raw_os_error().unwrap_or(0)) == Errno::ENODEV {
                LinkState::Missing
            } else {
                LinkState::Down
            };
            if link.change(&feed, state, Some(&error.to_string())).await.is_err() {
                return;
            }
            tokio::select! {
                () = feed.closing() => return,
                () = tokio::time::sleep(pause.next_delay()) => {}
            }
        }
    }

    fn open(&self) -> io::Result<Receiver> {
        let socket = CanFdSocket::open(&self.interface)?;
        if let Some(ids) = self.wanted.let_pass() {
            socket.set_filters(&filters(&ids))?;
        }
        socket.set_error_filter_accept_all()?;
        socket.set_nonblocking(true)?;
        Receiver::new(socket)
    }

    /// Whether the interface is there and on: a socket that is bound to one that is off has an error pending.
    fn is_up(&self) -> bool {
        CanFdSocket::open(&self.interface)
            .and_then(|socket| socket.as_raw_socket().take_error())
            .is_ok_and(|pending| pending.is_none())
    }

    async fn read(&self, receiver: Receiver, feed: &mut Feed, link: &mut Link, pause: &mut RetryDelay) -> Ended {
        let interest = Interest::READABLE | Interest::ERROR;
        #[expect(
            deprecated,
            reason = "its successor is unsafe and asks for what holds here: the receiver owns its one descriptor"
        )]
        let registered = AsyncFd::with_interest(receiver, interest);
        let mut fd = match registered {
            Ok(fd) => fd,
            Err(error) => return Ended::Failed(error),
        };
        let ended = self.receive(&mut fd, interest, feed, link, pause).await;
        // What was dropped after the last frame is known only to the socket.
        let dropped = fd.get_mut().dropped_since();
        if dropped > 0 {
            // The pipeline may be gone; then nothing is reported.
            let _ = feed.lost(LiveLoss::SocketQueue, dropped).await;
        }
        ended
    }

    async fn receive(
        &self,
        fd: &mut AsyncFd<Receiver>,
        interest: Interest,
        feed: &mut Feed,
        link: &mut Link,
        pause: &mut RetryDelay,
    ) -> Ended {
        if self.is_up() {
            if link.change(feed, LinkState::Up, None).await.is_err() {
                return Ended::Closing;
            }
            pause.reset();
        }
        let mut unwatched = Unwatched::new(&self.wanted);
        loop {
            let down = !link.is_up();
            let mut ready = tokio::select! {
                biased;
                () = feed.closing() => return drain(fd.get_mut(), &mut unwatched, feed, link, pause).await,
                ready = fd.ready_mut(interest) => match ready {
                    Ok(ready) => ready,
                    Err(error) => return Ended::Failed(error),
                },
                () = tokio::time::sleep(pause.next_delay()), if down => {
                    if self.is_up() {
                        pause.reset();
                        if link.change(feed, LinkState::Up, None).await.is_err() {
                            return Ended::Closing;
                        }
                    }
                    continue;
                }
            };
            let mut empty = false;
            for _ in 0..BATCH {
                match ready.get_inner_mut().receive(feed.bus(), now_ns) {
                    Ok(received) => {
                        if pass_on(received, &mut unwatched, feed, link, pause).await.is_err() {
                            return Ended::Closing;
                        }
                    }
                    Err(Errno::EWOULDBLOCK) => {
                        empty = true;
                        break;
                    }
                    Err(Errno::EINTR) => {}
                    // The socket stays bound, and works again when the interface is switched on.
                    Err(error @ Errno::ENETDOWN) => {
                        if link.change(feed, LinkState::Down, Some(error.desc())).await.is_err() {
                            return Ended::Closing;
                        }
                    }
                    Err(error) => return Ended::Failed(error.into()),
                }
            }
            if empty {
                ready.clear_ready();
                tokio::time::sleep(COALESCE).await;
            }
        }
    }
}

/// At the end: takes what was received before it. What comes later belongs to no run.
async fn drain(
    receiver: &mut Receiver,
    unwatched: &mut Unwatched<'_>,
    feed: &Feed,
    link: &mut Link,
    pause: &mut RetryDelay,
) -> Ended {
    let end_ns = now_ns();
    for _ in 0..QUEUE_INPUTS {
        match receiver.receive(feed.bus(), now_ns) {
            Ok(received) if received.frame.is_ok_and(|frame| frame.stamp_ns > end_ns) => break,
            Ok(received) => {
                if pass_on(received, unwatched, feed, link, pause).await.is_err() {
                    break;
                }
            }
            Err(_) => break,
        }
    }
    Ended::Closing
}

async fn pass_on(
    received: Received,
    unwatched: &mut Unwatched<'_>,
    feed: &Feed,
    link: &mut Link,
    pause: &mut RetryDelay,
) -> Result<(), Closed> {
    if received.dropped > 0 {
        feed.lost(LiveLoss::SocketQueue, received.dropped).await?;
    }
    if !link.is_up() {
        link.change(feed, LinkState::Up, None).await?;
        pause.reset();
    }
    match received.frame {
        Ok(frame) => match unwatched.hear(&frame) {
            Heard::Wanted => feed.frame(frame).await?,
            Heard::News(number) => {
                let bus = feed.bus();
                feed.send(Input::Unwatched { bus, number }).await?;
            }
            Heard::Known => {}
        },
        Err(_) => feed.lost(LiveLoss::Unreadable, 1).await?,
    }
    Ok(())
}

/// As many filters as the kernel takes (`CAN_RAW_FILTER_MAX`); with more, all frames come, and the pipeline drops the others.
const FILTERS_MAX: usize = 512;

/// The kernel's filters for some identifiers.
fn filters(ids: &BTreeSet<CanId>) -> Vec<CanFilter> {
    /// The flags take part in the comparison, so that remote frames and the other length of identifier do not pass.
    const FLAGS: u32 = socketcan::EFF | socketcan::RTR;
    let filter = |of: &CanId| {
        if of.extended {
            CanFilter::new(of.id | socketcan::EFF, MAX_EXTENDED_ID | FLAGS)
        } else {
            CanFilter::new(of.id, MAX_STANDARD_ID | FLAGS)
        }
    };
    ids.iter().map(filter).collect()
}

#[cfg(test)]
mod tests {
    use ema_wire::ActuatorId;

    use super::*;

    /// What the kernel does with a filter.
    fn passes(filters: &[CanFilter], can_id: u32) -> bool {
        let mut matching = filters.iter().map(AsRef::<libc::can_filter>::as_ref);
        matching.any(|filter| can_id & filter.can_mask == filter.can_id & filter.can_mask)
    }

    #[test]
    fn the_filters_pass_the_frames_of_the_configured_actuators_and_the_status_of_others() {
        let text = "[[actuator]]\nid = 0\n[[actuator]]\nid = 7\nbus = \"can0\"\n[[actuator]]\nid = 15\n\
                    [[actuator]]\nid = 8\nbus = \"can1\"\n[type.bench.sensors]\nsample_rate_hz = 400\n";
        let config = Config::from_toml_str(text, "hmd.toml").expect("valid");
        let Some(wanted) = Wanted::for_interface(&config, "can0").let_pass() else {
            panic!("expected identifiers")
        };
        let ids: Vec<ActuatorId> = [0, 7, 15].into_iter().filter_map(ActuatorId::new).collect();
        let filters = filters(&wanted);
        for can_id in 0..=MAX_STANDARD_ID {
            let expected = Message::from_id(can_id as u16)
                .is_some_and(|(id, message)| ids.contains(&id) || message == Message::Status);
            assert_eq!(passes(&filters, can_id), expected, "{can_id:#x}");
            assert!(!passes(&filters, can_id | socketcan::EFF), "{can_id:#x} extended");
            assert!(!passes(&filters, can_id | socketcan::RTR), "{can_id:#x} remote");
        }
    }

    #[test]
    fn beside_a_drive_every_frame_is_wanted() {
        let text = "[[actuator]]\nid = 1\nbus = \"can0\"\n[actuator.drive]\npreset = \"odrive\"\n\
                    [[actuator]]\nid = 0\nbus = \"can1\"\n[type.bench.sensors]\nsample_rate_hz = 400\n";
        let config = Config::from_toml_str(text, "hmd.toml").expect("valid");
        assert_eq!(Wanted::for_interface(&config, "can0"), Wanted::All);
        assert!(matches!(
            Wanted::for_interface(&config, "can1"),
            Wanted::Ids {
                has_dictionary: true,
                ..
            }
        ));
    }

    #[test]
    fn an_identifier_of_a_mapped_bus_is_no_status_of_the_dictionary() {
        let number = ActuatorId::new(3).expect("up to 15");
        let id = CanId::of_dictionary(Message::Status.id(number));
        for has_dictionary in [false, true] {
            let ids = BTreeSet::from([id]);
            let passed = Wanted::Ids { ids, has_dictionary }.let_pass().expect("identifiers");
            assert_eq!(passed.len() > 1, has_dictionary, "{passed:?}");
        }
    }

    #[test]
    fn an_identifier_of_29_bits_passes_as_such_only() {
        let ids = [(0x123, false), (0x0123_4567, true)].map(|(id, extended)| CanId { id, extended });
        let wanted = Wanted::Ids {
            ids: ids.into(),
            has_dictionary: false,
        };
        let Some(ids) = wanted.let_pass() else {
            panic!("expected identifiers")
        };
        let filters = filters(&ids);
        for (can_id, expected) in [
            (0x123, true),
            (0x123 | socketcan::EFF, false),
            (0x0123_4567 | socketcan::EFF, true),
            (0x0123_4567 | socketcan::EFF | socketcan::RTR, false),
            (0x167, false),
        ] {
            assert_eq!(passes(&filters, can_id), expected, "{can_id:#x}");
        }
    }
}

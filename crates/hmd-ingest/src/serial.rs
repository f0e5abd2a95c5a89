//! A serial line (tty or pty) as a source of frames. Receive only: the device is opened for reading.
//!
//! A frame is the bytes between two zeros, good or not; decoding belongs to the pipeline, so that replay runs the very
//! same. The device may be missing at the start, be unplugged and come back, under the same path: the source reports it and
//! goes on. Where it joins the line, the rest of a frame that had begun before is no loss, and is passed over.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use ema_wire::{SerialPacket, Splitter};
use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;
use rustix::termios::{ControlModes, OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;

use super::feed::{COALESCE, Closed, Feed, Link, LinkState, REOPENED_WITHIN};
use hmd_core::frame::RawFrame;
use hmd_storage::clock::now_ns;
use hmd_storage::retry_delay::RetryDelay;

/// Bytes taken at once: as many as the kernel holds for a terminal.
const READ_BYTES: usize = 4096;

/// One serial device.
#[derive(Clone, Debug)]
pub struct SerialSource {
    device: PathBuf,
    bitrate_bit_s: u32,
}

/// Why a device is not read any more.
enum Ended {
    Closing,
    Failed(io::Error),
}

impl SerialSource {
    /// A source for the terminal at `device`, with eight data bits, no parity and one stop bit at this rate. A
    /// pseudo-terminal has no rate.
    #[must_use]
    pub fn new(device: &Path, bitrate_bit_s: u32) -> Self {
        Self {
            device: device.to_owned(),
            bitrate_bit_s,
        }
    }

    /// Receives until the feed closes.
    pub async fn run(self, mut feed: Feed) {
        let (mut pause, mut link) = (RetryDelay::up_to(REOPENED_WITHIN), Link::default());
        loop {
            let ended = match self.open() {
                Ok(file) => read(file, &mut feed, &mut link, &mut pause).await,
                Err(error) => Ended::Failed(error),
            };
            let Ended::Failed(error) = ended else { return };
            let state = match error.raw_os_error() {
                Some(libc::ENOENT | libc::ENODEV | libc::ENXIO) => LinkState::Missing,
                _ => LinkState::Down,
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

    /// Opens the device and lets every byte through as it is. What came before belongs to no run. Two readers of one device would each
    /// get a part of its bytes: the second one is refused.
    fn open(&self) -> io::Result<File> {
        let flags = libc::O_NOCTTY | libc::O_NONBLOCK;
        let file = OpenOptions::new().read(true).custom_flags(flags).open(&self.device)?;
        let mut settings = tcgetattr(&file).map_err(|error| match error {
            Errno::NOTTY => no_terminal(&file),
            error => error.into(),
        })?;
        flock(&file, FlockOperation::NonBlockingLockExclusive).map_err(|error| match error {
            Errno::WOULDBLOCK => io::Error::new(ErrorKind::ResourceBusy, "another reader has it"),
            error => error.into(),
        })?;
        settings.make_raw();
        settings.control_modes |= ControlModes::CREAD | ControlModes::CLOCAL;
        settings.control_modes &= !(ControlModes::CSTOPB | ControlModes::CRTSCTS);
        settings.set_speed(self.bitrate_bit_s)?;
        tcsetattr(&file, OptionalActions::Now, &settings)?;
        tcflush(&file, QueueSelector::IFlush)?;
        Ok(file)
    }
}

/// The error of a device that is no terminal.
fn no_terminal(file: &File) -> io::Error {
    let found = match file.metadata().map(|about| about.file_type()) {
        Ok(kind) if kind.is_file() => "a regular file",
        Ok(kind) if kind.is_dir() => "a folder",
        Ok(kind) if kind.is_fifo() => "a pipe",
        Ok(_) => "another device",
        Err(error) => return error,
    };
    io::Error::new(ErrorKind::InvalidInput, format!("expected a terminal, found {found}"))
}

async fn read(file: File, feed: &mut Feed, link: &mut Link, pause: &mut RetryDelay) -> Ended {
    #[expect(
        deprecated,
        reason = "its successor is unsafe and asks for what holds here: the file owns its one descriptor"
    )]
    let registered = AsyncFd::with_interest(file, Interest::READABLE);
    let mut fd = match registered {
        Ok(fd) => fd,
        Err(error) => return Ended::Failed(error),
    };
    if link.change(feed, LinkState::Up, None).await.is_err() {
        return Ended::Closing;
    }
    let mut line = Line::default();
    let mut buffer = [0; READ_BYTES];
    loop {
        let mut ready = tokio::select! {
            biased;
            () = feed.closing() => return Ended::Closing,
            ready = fd.readable_mut() => match ready {
                Ok(ready) => ready,
                Err(error) => return Ended::Failed(error),
            },
        };
        let received = ready.get_inner_mut().read(&mut buffer);
        let bytes = match received {
            Ok(0) => Err(io::Error::new(ErrorKind::UnexpectedEof, "it hung up")),
            Ok(length) => Ok(&buffer[..length]),
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                ready.clear_ready();
                tokio::time::sleep(COALESCE).await;
                continue;
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(error) => Err(error),
        };
        let stamp_ns = now_ns();
        match bytes {
            Ok(bytes) => {
                pause.reset();
                if line.pass_on(bytes, stamp_ns, feed).await.is_err() {
                    return Ended::Closing;
                }
            }
            Err(error) => {
                // What has come of a frame that will not end.
                let rest = line.splitter.finish();
                if let Some(frame) = rest
                    && feed
                        .frame(RawFrame::of_serial(stamp_ns, feed.bus(), frame))
                        .await
                        .is_err()
                {
                    return Ended::Closing;
                }
                return Ended::Failed(error);
            }
        }
    }
}

/// Position of the source in the byte stream.
#[derive(Debug, Default)]
struct Line {
    splitter: Splitter,
    /// A zero was seen, so that frames are whole.
    joined: bool,
}

impl Line {
    async fn pass_on(&mut self, bytes: &[u8], stamp_ns: u64, feed: &Feed) -> Result<(), Closed> {
        for &byte in bytes {
            let frame = self.splitter.push(byte);
            let rest_of_a_frame = !self.joined && frame.is_some_and(|frame| SerialPacket::parse(frame).is_err());
            if let Some(frame) = frame.filter(|_| !rest_of_a_frame) {
                feed.frame(RawFrame::of_serial(stamp_ns, feed.bus(), frame)).await?;
            }
            self.joined |= byte == 0;
        }
        Ok(())
    }
}

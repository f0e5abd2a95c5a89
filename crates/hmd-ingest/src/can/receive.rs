//! One frame out of a socket, with its stamp and the kernel's count of what it dropped before.

use std::io::{self, IoSliceMut};
use std::os::fd::{AsRawFd, RawFd};

use nix::errno::Errno;
use nix::sys::socket::{ControlMessageOwned, MsgFlags, TimestampingFlag, recvmsg, setsockopt, sockopt};
use nix::sys::time::TimeSpec;
use socketcan::{CanFdSocket, SocketOptions};

use super::stamp::HardwareClock;
use hmd_core::frame::{FrameError, FrameFlags, RawFrame};

/// Receive buffer asked for, bytes: about half a second of a full bus of 1 Mbit/s (the kernel counts some 800 bytes for
/// each frame). More than `net.core.rmem_max` is given only to a process with `CAP_NET_ADMIN`.
const RECEIVE_BUFFER_BYTES: usize = 4 << 20;

/// Bytes of the kernel's `struct can_frame` and `struct canfd_frame`.
const CLASSIC_BYTES: usize = 16;
const FD_BYTES: usize = 72;
/// Where the data begin in both.
const DATA_AT: usize = 8;
/// Bits of `canfd_frame.flags`.
const FD_BIT_RATE_SWITCH: u8 = 1;
const FD_ERROR_STATE: u8 = 2;

/// Option `SO_MEMINFO` and the place of the drop counter in what it returns, of `linux/sock_diag.h`.
const MEMINFO_DROPS: usize = 8;
const MEMINFO_WORDS: usize = 9;

/// A socket that is only ever read.
#[derive(Debug)]
pub(super) struct Receiver {
    socket: CanFdSocket,
    control: Vec<u8>,
    clock: HardwareClock,
    /// The kernel's counter when it was last seen; it wraps.
    dropped: u32,
}

/// What one read gave.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Received {
    /// The frame; an error when no bus can have carried it.
    pub(super) frame: Result<RawFrame, FrameError>,
    /// Frames that the kernel dropped before it, because the queue was full.
    pub(super) dropped: u64,
}

impl Receiver {
    pub(super) fn new(socket: CanFdSocket) -> io::Result<Self> {
        if setsockopt(&socket, sockopt::RcvBufForce, &RECEIVE_BUFFER_BYTES).is_err() {
            setsockopt(&socket, sockopt::RcvBuf, &RECEIVE_BUFFER_BYTES)?;
        }
        let stamps = TimestampingFlag::SOF_TIMESTAMPING_RX_SOFTWARE
            | TimestampingFlag::SOF_TIMESTAMPING_SOFTWARE
            | TimestampingFlag::SOF_TIMESTAMPING_RX_HARDWARE
            | TimestampingFlag::SOF_TIMESTAMPING_RAW_HARDWARE;
        setsockopt(&socket, sockopt::Timestamping, &stamps)?;
        setsockopt(&socket, sockopt::RxqOvfl, &1)?;
        Ok(Self {
            socket,
            control: nix::cmsg_space!([TimeSpec; 3], u32),
            clock: HardwareClock::default(),
            dropped: 0,
        })
    }

    /// Takes one frame; `now_ns` is asked when the kernel gave no stamp.
    ///
    /// # Errors
    /// `EWOULDBLOCK` when there is none, or what is wrong with the interface.
    pub(super) fn receive(&mut self, bus: u16, now_ns: fn() -> u64) -> Result<Received, Errno> {
        let mut bytes = [0; FD_BYTES];
        let mut slice = [IoSliceMut::new(&mut bytes)];
        let message = recvmsg::<()>(
            self.socket.as_raw_fd(),
            &mut slice,
            Some(&mut self.control),
            MsgFlags::MSG_DONTWAIT,
        )?;
        let (mut stamp_ns, mut dropped) = (None, self.dropped);
        for control in message.cmsgs()? {
            match control {
                ControlMessageOwned::ScmTimestampsns(stamps) => {
                    let (software, hardware) = (nanoseconds(stamps.system), nanoseconds(stamps.hw_raw));
                    stamp_ns = match (software, hardware) {
                        (Some(software), Some(hardware)) => Some(self.clock.utc_ns(hardware, software)),
                        (software, _) => software,
                    };
                }
                ControlMessageOwned::RxqOvfl(count) => dropped = count,
                _ => {}
            }
        }
        let length = message.bytes;
        let since = dropped.wrapping_sub(std::mem::replace(&mut self.dropped, dropped));
        Ok(Received {
            frame: frame(&bytes[..length], stamp_ns.unwrap_or_else(now_ns), bus),
            dropped: u64::from(since),
        })
    }

    /// Frames dropped since the last one that was received.
    pub(super) fn dropped_since(&mut self) -> u64 {
        let mut words = [0; 4 * MEMINFO_WORDS];
        let read = self
            .socket
            .get_socket_option_bytes(libc::SOL_SOCKET, libc::SO_MEMINFO, &mut words);
        let Some(word) = read
            .ok()
            .and_then(|length| words[..length].chunks_exact(4).nth(MEMINFO_DROPS))
        else {
            return 0;
        };
        let count = word.try_into().map_or(self.dropped, u32::from_ne_bytes);
        u64::from(count.wrapping_sub(std::mem::replace(&mut self.dropped, count)))
    }
}

impl AsRawFd for Receiver {
    fn as_raw_fd(&self) -> RawFd {
        self.socket.as_raw_fd()
    }
}

/// A stamp that is there: the kernel fills in zero for none.
fn nanoseconds(stamp: TimeSpec) -> Option<u64> {
    let ns = i128::from(stamp.tv_sec()) * 1_000_000_000 + i128::from(stamp.tv_nsec());
    u64::try_from(ns).ok().filter(|&ns| ns > 0)
}

/// The frame in the kernel's `struct can_frame` or `struct canfd_frame`: identifier with flags, length, FD flags, two
/// bytes that do not matter here, data.
fn frame(bytes: &[u8], stamp_ns: u64, bus: u16) -> Result<RawFrame, FrameError> {
    let fd = bytes.len() == FD_BYTES;
    let refused = FrameError::Length { got: bytes.len(), fd };
    if bytes.len() != CLASSIC_BYTES && !fd {
        return Err(refused);
    }
    let id = u32::from_ne_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let data = bytes[DATA_AT..].get(..usize::from(bytes[4])).ok_or(refused)?;
    let flags = FrameFlags::NONE
        .with(FrameFlags::FD, fd)
        .with(FrameFlags::BIT_RATE_SWITCH, fd && bytes[5] & FD_BIT_RATE_SWITCH != 0)
        .with(FrameFlags::ERROR_STATE, fd && bytes[5] & FD_ERROR_STATE != 0);
    RawFrame::from_socketcan(stamp_ns, bus, id, flags, data)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kernel(id: u32, length: u8, flags: u8, data: &[u8], size: usize) -> Vec<u8> {
        let mut bytes = id.to_ne_bytes().to_vec();
        bytes.extend([length, flags, 0, 0]);
        bytes.extend(data);
        bytes.resize(size, 0);
        bytes
    }

    #[test]
    fn both_kernel_structures_become_frames() {
        let bytes = kernel(0x123, 3, 0, &[1, 2, 3], CLASSIC_BYTES);
        let expected = RawFrame::new(9, 2, 0x123, FrameFlags::NONE, &[1, 2, 3]);
        assert_eq!(frame(&bytes, 9, 2), expected);

        let data: Vec<u8> = (0..64).collect();
        let bytes = kernel(0x8000_0000 | 0x1234_5678, 64, 3, &data, FD_BYTES);
        let flags = [
            FrameFlags::EXTENDED,
            FrameFlags::FD,
            FrameFlags::BIT_RATE_SWITCH,
            FrameFlags::ERROR_STATE,
        ];
        let flags = flags.into_iter().fold(FrameFlags::NONE, FrameFlags::union);
        let expected = RawFrame::new(9, 0, 0x1234_5678, flags, &data);
        assert_eq!(frame(&bytes, 9, 0), expected);

        let bytes = kernel(0x2000_0040, 8, 0, &[0; 8], CLASSIC_BYTES);
        assert!(frame(&bytes, 9, 0).is_ok_and(|frame| frame.is_error()));
    }

    #[test]
    fn what_no_bus_carries_is_refused() {
        assert!(frame(&[0; 15], 0, 0).is_err());
        assert!(frame(&kernel(1, 9, 0, &[], CLASSIC_BYTES), 0, 0).is_err());
        assert!(frame(&kernel(1, 9, 0, &[], FD_BYTES), 0, 0).is_err());
        assert!(frame(&kernel(1, 200, 0, &[], FD_BYTES), 0, 0).is_err());
    }
}

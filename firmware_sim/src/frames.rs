//! Packets as frames: COBS frames on the serial line, classic frames on the CAN bus.

use ema_wire::can::{CLASSIC_LEN, Frame};
use ema_wire::serial::MAX_FRAME_LEN;
use ema_wire::{Message, SerialPacket};

use crate::device::Timed;

/// One frame on the serial line, with the zero at its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SerialFrame {
    pub(crate) bytes: [u8; MAX_FRAME_LEN],
    pub(crate) len: usize,
}

impl SerialFrame {
    /// The frame of a packet.
    #[must_use]
    pub fn new(packet: &SerialPacket) -> Self {
        let mut bytes = [0; MAX_FRAME_LEN];
        // Every packet fits into MAX_FRAME_LEN bytes, which `ema-wire` tests.
        let len = packet.emit(&mut bytes).map_or(0, <[u8]>::len);
        Self { bytes, len }
    }

    /// The bytes of the frame.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

/// One classic frame on the CAN bus, or the error frame that replaces it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CanFrame {
    /// A data frame with an 11-bit identifier.
    Data {
        /// Message of the frame.
        message: Message,
        /// Identifier.
        id: u16,
        /// Data bytes.
        data: [u8; CLASSIC_LEN],
    },
    /// A disturbed frame, which every receiver detects by its checksum.
    Error,
}

impl CanFrame {
    /// The frames of a packet, in bus order: three for a sample, one for a status.
    #[must_use]
    pub fn from_packet(packet: &SerialPacket) -> heapless::Vec<Self, 3> {
        let mut frames = heapless::Vec::new();
        let mut push = |actuator, frame: Frame| {
            let (message, mut buffer) = (frame.message(), [0; 64]);
            if let Ok(data) = frame.emit(&mut buffer).try_into() {
                let id = message.id(actuator);
                // A packet has at most three frames.
                let _ = frames.push(Self::Data { message, id, data });
            }
        };
        match *packet {
            SerialPacket::Sample(sample) => {
                for frame in sample.to_frames() {
                    push(sample.actuator, frame);
                }
            }
            SerialPacket::Status { actuator, status } => push(actuator, Frame::Status(status)),
        }
        frames
    }
}

/// Packets as frames of the serial line.
#[derive(Clone, Debug)]
pub struct SerialFrames<I>(pub I);

impl<I: Iterator<Item = Timed<SerialPacket>>> Iterator for SerialFrames<I> {
    type Item = Timed<SerialFrame>;

    fn next(&mut self) -> Option<Self::Item> {
        self.0.next().map(|timed| timed.map(|packet| SerialFrame::new(&packet)))
    }
}

/// Packets as frames of the CAN bus; the frames of a packet are sent back to back.
#[derive(Clone, Debug)]
pub struct CanFrames<I> {
    packets: I,
    at_us: u64,
    /// Frames of the current packet that are not sent yet.
    rest: heapless::Deque<CanFrame, 3>,
}

impl<I> CanFrames<I> {
    /// Duration of a frame on a bus of 1 Mbit/s, µs.
    pub const FRAME_US: u64 = 120;

    /// The frames of these packets.
    pub fn new(packets: I) -> Self {
        Self {
            packets,
            at_us: 0,
            rest: heapless::Deque::new(),
        }
    }
}

impl<I: Iterator<Item = Timed<SerialPacket>>> Iterator for CanFrames<I> {
    type Item = Timed<CanFrame>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            let packet = self.packets.next()?;
            // The status follows the frames of its sample.
            self.at_us = packet.at_us.max(self.at_us);
            for frame in CanFrame::from_packet(&packet.value) {
                // The queue has room for the frames of one packet.
                let _ = self.rest.push_back(frame);
            }
        }
        let value = self.rest.pop_front()?;
        let at_us = self.at_us;
        self.at_us += Self::FRAME_US;
        Some(Timed { at_us, value })
    }
}

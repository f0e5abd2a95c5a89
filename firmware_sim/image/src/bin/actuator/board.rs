//! What the program must know of its board: its serial port, and the timer that tells it the time.
#![allow(unsafe_code, reason = "registers; the only place of this program that needs it")]

use core::ptr::{read_volatile, write_volatile};

/// Clock of the board's peripherals, MHz.
const CLOCK_MHZ: u64 = 25;

/// Serial port 0 of the board.
mod uart {
    pub(super) const DATA: *mut u32 = 0x4000_4000 as *mut u32;
    pub(super) const STATE: *mut u32 = 0x4000_4004 as *mut u32;
    pub(super) const CONTROL: *mut u32 = 0x4000_4008 as *mut u32;
    pub(super) const DIVIDER: *mut u32 = 0x4000_4010 as *mut u32;
    /// In `STATE`: no room for another byte to send; a byte came.
    pub(super) const FULL: u32 = 1;
    pub(super) const CAME: u32 = 2;
    /// In `CONTROL`: send and receive.
    pub(super) const ON: u32 = 3;
    /// 921 600 bit/s, nearly.
    pub(super) const CLOCKS_PER_BIT: u32 = 27;
}

/// Timer 0 of the board, counting down: control, value, reload.
mod timer {
    pub(super) const CONTROL: *mut u32 = 0x4000_0000 as *mut u32;
    pub(super) const VALUE: *mut u32 = 0x4000_0004 as *mut u32;
    pub(super) const RELOAD: *mut u32 = 0x4000_0008 as *mut u32;
}

/// The serial port.
pub(crate) struct Uart(());

impl Uart {
    /// Switches it on.
    pub(crate) fn start() -> Self {
        // SAFETY: registers of this board, which nothing else uses.
        unsafe {
            write_volatile(uart::DIVIDER, uart::CLOCKS_PER_BIT);
            write_volatile(uart::CONTROL, uart::ON);
        }
        Self(())
    }

    /// Sends bytes; waits while there is no room.
    pub(crate) fn send(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            // SAFETY: as in `start`.
            unsafe {
                while read_volatile(uart::STATE) & uart::FULL != 0 {}
                write_volatile(uart::DATA, u32::from(byte));
            }
        }
    }

    /// Waits for a byte.
    pub(crate) fn receive(&mut self) -> u8 {
        // SAFETY: as in `start`.
        unsafe {
            while read_volatile(uart::STATE) & uart::CAME == 0 {}
            read_volatile(uart::DATA) as u8
        }
    }
}

/// The time since its start.
pub(crate) struct Clock {
    last: u32,
    /// Ticks so far.
    elapsed: u64,
}

impl Clock {
    /// Starts the timer.
    pub(crate) fn start() -> Self {
        // SAFETY: registers of this board, which nothing else uses.
        unsafe {
            write_volatile(timer::RELOAD, u32::MAX);
            write_volatile(timer::VALUE, u32::MAX);
            write_volatile(timer::CONTROL, 1);
        }
        Self {
            last: u32::MAX,
            elapsed: 0,
        }
    }

    /// Waits until `at_us` microseconds have passed. To be called at least every 171 s, before the timer comes round.
    pub(crate) fn wait_until(&mut self, at_us: u64) {
        loop {
            // SAFETY: as in `start`.
            let now = unsafe { read_volatile(timer::VALUE) };
            self.elapsed += u64::from(self.last.wrapping_sub(now));
            self.last = now;
            if self.elapsed >= at_us * CLOCK_MHZ {
                return;
            }
        }
    }
}

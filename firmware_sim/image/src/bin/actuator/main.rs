//! The actuator's control electronics on the processor: controller, motor and sensors of `firmware_sim`, whose frames go out
//! through the board's serial port.
//!
//! It waits for one line of settings on that port, sends each frame in its time (or as soon as it can, if the processor is
//! too slow for the time), and stands still after the last one. `cargo xtask firmware` builds it and listens to it with `hmd run`.
#![no_std]
#![no_main]

mod board;

use core::fmt::Write;

use board::{Clock, Uart};
use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hio};
use ema_wire::ActuatorId;
use firmware_sim::{BadSetting, Plan, SerialFrames, Settings};

/// Longest line of settings, bytes: every setting and every effect has room.
const LINE_MAX: usize = 4096;

#[entry]
fn main() -> ! {
    let mut uart = Uart::start();
    match plan(&mut uart) {
        Ok(plan) => {
            let mut clock = Clock::start();
            for frame in SerialFrames(plan.start()) {
                clock.wait_until(frame.at_us);
                uart.send(frame.value.bytes());
            }
        }
        Err(bad) => fail(&bad),
    }
    halt()
}

/// What the line of settings asks for.
fn plan(uart: &mut Uart) -> Result<Plan, BadSetting> {
    let mut buffer = [0; LINE_MAX];
    let line = line(uart, &mut buffer).ok_or(BadSetting(""))?;
    let first = ActuatorId::new(0).ok_or(BadSetting("id"))?;
    Settings::new(first, 1).with_text(line)?.plan()
}

/// A line; `None` if it does not fit or is no text.
fn line<'a>(uart: &mut Uart, buffer: &'a mut [u8]) -> Option<&'a str> {
    let mut length = 0;
    loop {
        match uart.receive() {
            b'\n' => return core::str::from_utf8(&buffer[..length]).ok(),
            byte => *buffer.get_mut(length)? = byte,
        }
        length += 1;
    }
}

/// Says on the debugger's console what is wrong, and ends.
fn fail(why: &dyn core::fmt::Display) {
    if let Ok(mut console) = hio::hstderr() {
        // Nothing is left to tell it to.
        let _ = writeln!(console, "actuator: {why}");
    }
    debug::exit(debug::EXIT_FAILURE);
}

fn halt() -> ! {
    loop {
        core::hint::spin_loop();
    }
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    fail(info);
    halt()
}

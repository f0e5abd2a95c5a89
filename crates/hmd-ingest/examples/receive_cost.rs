//! What it costs to take frames out of a socket one by one with their stamps, as a CAN source does:
//! `cargo run --release -p hmd-ingest --example receive_cost`.
//!
//! Datagrams of 16 bytes over the loopback take the place of frames, since not every machine has a CAN interface.
#![allow(clippy::print_stdout, reason = "it prints a figure")]

use std::io::IoSliceMut;
use std::net::UdpSocket;
use std::os::fd::AsRawFd;
use std::time::{Duration, Instant};

use nix::sys::socket::{MsgFlags, TimestampingFlag, recvmsg, setsockopt, sockopt};
use nix::sys::time::TimeSpec;

/// Frames that wait at once.
const WAITING: usize = 200;

const ROUNDS: usize = 500;

/// Frames of 64 actuators at 400 Hz each second.
const FRAMES_PER_S: f64 = 64.0 * 400.0 * 3.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (from, to) = (UdpSocket::bind("127.0.0.1:0")?, UdpSocket::bind("127.0.0.1:0")?);
    from.connect(to.local_addr()?)?;
    let stamps = TimestampingFlag::SOF_TIMESTAMPING_RX_SOFTWARE | TimestampingFlag::SOF_TIMESTAMPING_SOFTWARE;
    setsockopt(&to, sockopt::Timestamping, &stamps)?;
    setsockopt(&to, sockopt::RxqOvfl, &1)?;
    let mut control = nix::cmsg_space!([TimeSpec; 3], u32);
    let mut took = Duration::ZERO;
    for _ in 0..ROUNDS {
        for _ in 0..WAITING {
            from.send(&[0; 16])?;
        }
        let since = Instant::now();
        for _ in 0..WAITING {
            let mut bytes = [0; 72];
            let mut slice = [IoSliceMut::new(&mut bytes)];
            let message = recvmsg::<()>(to.as_raw_fd(), &mut slice, Some(&mut control), MsgFlags::MSG_DONTWAIT)?;
            std::hint::black_box(message.cmsgs()?.count());
        }
        took += since.elapsed();
    }
    let each_s = took.as_secs_f64() / (ROUNDS * WAITING) as f64;
    println!(
        "{:.2} us each, {:.1} % of a core at {FRAMES_PER_S:.0} frames/s",
        1e6 * each_s,
        100.0 * each_s * FRAMES_PER_S
    );
    Ok(())
}

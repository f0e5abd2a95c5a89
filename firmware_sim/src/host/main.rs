//! The program `firmware_sim`: sends a simulated actuator's frames to a file, a serial line or a CAN bus.

mod args;
mod output;

use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::error::ErrorKind;
use clap::{CommandFactory, Parser};
use firmware_sim::{CanFrames, Link, SerialFrames, Timed};

use args::Args;
use output::{Output, OutputError};

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("firmware_sim: {message}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<(), String> {
    // Options that are right alone and wrong together are refused as the parser refuses one.
    let plan = args
        .plan()
        .unwrap_or_else(|message| Args::command().error(ErrorKind::ValueValidation, message).exit());
    let faults = args.faults();
    let device = faults.with_stuck_sensors(plan.start(), args.seed);
    let output = args.output()?;
    let paced = args.pace.map_or(output.is_live(), |pace| pace == args::Pace::RealTime);
    let sent = match output {
        Output::Serial(mut line) => {
            let frames = Link::new(SerialFrames(device), faults, args.seed);
            send(frames, paced, |frame| line.send(frame.bytes())).and_then(|()| line.finish())
        }
        Output::Can(bus) => {
            let frames = Link::new(CanFrames::new(device), faults, args.seed);
            send(frames, paced, |frame| bus.send(&frame))
        }
    };
    match sent {
        // A receiver that closes the line is not a failure.
        Err(OutputError::HungUp) | Ok(()) => Ok(()),
        Err(OutputError::Failed(message)) => Err(message),
    }
}

/// Sends the frames, each at its time if `paced`, else as soon as possible.
fn send<F>(
    frames: impl Iterator<Item = Timed<F>>,
    paced: bool,
    mut send: impl FnMut(F) -> Result<(), OutputError>,
) -> Result<(), OutputError> {
    let start = Instant::now();
    for frame in frames {
        if paced {
            let due = Duration::from_micros(frame.at_us);
            std::thread::sleep(due.saturating_sub(start.elapsed()));
        }
        send(frame.value)?;
    }
    Ok(())
}

//! `firmware_sim`: a simulated actuator talks on a serial line; the line is stdout or a file.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::{ActuatorParams, FAULT_COUNT, FaultVector, Profile};
use ema_wire::ActuatorId;
use firmware_sim::write_stream;

/// Send a simulated actuator's samples and status as serial packets.
#[derive(Debug, Parser)]
#[command(version, about)]
struct Args {
    /// File or device to write to; stdout without it.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// The fault vector, k1,…,k8.
    #[arg(long, value_parser = fault_vector, default_value = "0,0,0,0,0,0,0.5,0.5", value_name = "K1,…,K8")]
    k: FaultVector,
    /// What each actuation commands.
    #[arg(long, value_parser = profile, default_value = "mixed", value_name = "step|ramp|chirp|mixed")]
    profile: Profile,
    /// Number of actuations, their direction alternating.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    windows: u32,
    /// Sampling rate, Hz; default that of the type.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Current noise, A rms; above 0 the 12-bit converters are in the path too.
    #[arg(long, default_value_t = 0.0, value_parser = not_negative)]
    noise: f64,
    /// Constant load at the output, Nm; positive opposes positive motion.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite, value_name = "NM")]
    load: f64,
    /// Type of the actuator.
    #[arg(long, default_value = "bench", value_parser = ["bench", "servo28"])]
    actuator: String,
    /// Number of the actuator in its packets.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..16))]
    id: u8,
    /// Draws rotor angle, place in the backlash, first direction and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

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
    let actuator = ActuatorId::new(args.id).ok_or("--id: expected 0 to 15")?;
    let scenario = scenario(args)?;
    let (name, mut out): (String, Box<dyn Write>) = match &args.output {
        Some(path) => {
            let name = path.display().to_string();
            let file = File::create(path).map_err(|e| format!("{name}: {e}"))?;
            (name, Box::new(BufWriter::new(file)))
        }
        None => ("stdout".to_owned(), Box::new(BufWriter::new(io::stdout().lock()))),
    };
    match write_stream(&scenario, actuator, &mut out) {
        // A listener that hangs up is no failure.
        Err(e) if e.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        other => other.map_err(|e| format!("{name}: {e}")),
    }
}

fn scenario(args: &Args) -> Result<Scenario, String> {
    let mut params = match args.actuator.as_str() {
        "servo28" => ActuatorParams::servo28(),
        _ => ActuatorParams::bench(),
    };
    if let Some(rate) = args.rate {
        params.sensors.sample_rate = rate;
        params = params.checked().map_err(|e| format!("--rate: {e}"))?;
    }
    Ok(Scenario {
        load_torque: args.load,
        sensing: CurrentSensing {
            quantised: args.noise > 0.0,
            noise_rms: args.noise,
        },
        actuations: Actuations {
            profile: args.profile,
            count: args.windows,
            rest: 0.5,
            length: 0.5,
        },
        ..Scenario::new(params, args.k, args.seed)
    })
}

fn fault_vector(text: &str) -> Result<FaultVector, String> {
    let k: Vec<f64> = text
        .split(',')
        .map(|number| {
            number
                .trim()
                .parse()
                .map_err(|_| format!("expected a number, found {number:?}"))
        })
        .collect::<Result<_, _>>()?;
    let found = k.len();
    let k: [f64; FAULT_COUNT] = k
        .try_into()
        .map_err(|_| format!("expected {FAULT_COUNT} numbers, found {found}"))?;
    let fault = FaultVector::from_array(k);
    if fault.is_valid() {
        Ok(fault)
    } else {
        Err("expected numbers from 0 to 1".to_owned())
    }
}

fn profile(text: &str) -> Result<Profile, String> {
    let found = Profile::NAMES.into_iter().find(|(name, _)| *name == text);
    found
        .map(|(_, profile)| profile)
        .ok_or_else(|| "expected step, ramp, chirp or mixed".to_owned())
}

fn finite(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|x: &f64| x.is_finite())
        .ok_or_else(|| "expected a finite number".to_owned())
}

fn not_negative(text: &str) -> Result<f64, String> {
    finite(text).and_then(|x| {
        if x >= 0.0 {
            Ok(x)
        } else {
            Err("expected a number not below 0".to_owned())
        }
    })
}

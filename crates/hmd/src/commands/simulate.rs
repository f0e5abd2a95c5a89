//! `hmd simulate`: the reference model writes a log, and its truth beside it.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;
use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::{FAULT_COUNT, FaultVector, Profile};
use ema_wire::ActuatorId;
use ema_wire::bus_load::bus_load;
use serde::Serialize;

use super::{Exit, Misuse, load_config, no_input, unknown_type};
use hmd_core::config::LOAD_MAX;
use hmd_core::frame::BusNames;
use hmd_ingest::candump::{Decimals, emit};
use hmd_lab::simulate::{EPOCH_NS, traffic};
use hmd_storage::mcap_writer::{McapWriter, SyncedFile};

/// Bit rate of the simulated bus.
const BIT_RATE_BIT_S: f64 = 1e6;

/// Name of the simulated interface.
const INTERFACE: &str = "can0";

/// Write a log of simulated actuations.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd simulate -o worn.log --fault friction=0.4 --noise 0.05 --seed 7\n\
    \x20 hmd simulate -o slow.mcap --rate 400 --windows 5 --k 0.2,0,0,0.1,0,0,0.5,0.5")]
pub struct Args {
    /// Log to write: `.mcap`, or `.log` for candump text.
    #[arg(short, long)]
    output: PathBuf,
    /// The whole fault vector, k1,…,k8.
    #[arg(long, value_delimiter = ',', value_name = "K1,…,K8")]
    k: Vec<f64>,
    /// One fault by name (friction, backlash, short_a, short_b, short_c, eccentricity, eccentricity_phase, gain).
    #[arg(long, value_parser = named_fault, value_name = "NAME=K")]
    fault: Vec<(usize, f64)>,
    /// What each actuation commands.
    #[arg(long, value_parser = named_profile, default_value = "mixed", value_name = "step|ramp|chirp|mixed")]
    profile: Profile,
    /// Number of actuations, their direction alternating.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    windows: u32,
    /// Sampling rate, Hz; default that of the type.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Current noise, A rms; above 0 the current converters are in the path too.
    #[arg(long, default_value_t = 0.0, value_parser = not_negative)]
    noise: f64,
    /// Constant load at the output, Nm; positive opposes positive motion.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite, value_name = "NM")]
    load: f64,
    /// Type of the actuator: bench, servo28, servo270 or one of the configuration's.
    #[arg(long, default_value = "bench", value_name = "TYPE")]
    actuator: String,
    /// CAN number of the actuator.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..16))]
    id: u8,
    /// Configuration that defines further types.
    #[arg(short, long)]
    config: Option<PathBuf>,
    /// Draws rotor angle, place in the backlash, first direction and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// One line of the truth file.
#[derive(Serialize)]
struct Truth<'a> {
    actuator: &'a str,
    window: u32,
    k: [f64; FAULT_COUNT],
}

/// Runs the verb.
///
/// # Errors
/// A bad configuration or argument, or a file that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    no_input(&args.output, &args.config)?;
    no_input(&truth_path(&args.output), &args.config)?;
    let config = load_config(args.config.as_deref())?;
    let Some(found) = config.actuator_type(&args.actuator) else {
        return Err(unknown_type(&args.actuator).into());
    };
    let mut params = found.params;
    if let Some(rate) = args.rate {
        params.sensors.sample_rate = rate;
        params = params.checked().map_err(|e| Misuse(format!("--rate: {e}")))?;
    }
    let load = bus_load(params.sensors.sample_rate, 1, BIT_RATE_BIT_S);
    if load > LOAD_MAX {
        return Err(Misuse(format!(
            "--rate: expected at most {:.0} % of a 1 Mbit/s bus, found {:.0} %",
            100.0 * LOAD_MAX,
            100.0 * load
        ))
        .into());
    }
    let fault = fault_vector(args)?;
    let sensing = CurrentSensing {
        quantised: args.noise > 0.0,
        noise_rms: args.noise,
    };
    let scenario = Scenario {
        load_torque: args.load,
        sensing,
        actuations: Actuations {
            profile: args.profile,
            count: args.windows,
            rest: 0.5,
            length: 0.5,
        },
        ..Scenario::new(params, fault, args.seed)
    };
    let Some(actuator) = ActuatorId::new(args.id) else {
        return Err(Misuse(format!("--id: expected 0 to 15, found {}", args.id)).into());
    };
    write_log(&args.output, &scenario, actuator)?;

    let name = actuator.to_string();
    let truth_path = truth_path(&args.output);
    let mut truth = BufWriter::new(create(&truth_path)?);
    for window in 0..args.windows {
        let line = Truth {
            actuator: &name,
            window,
            k: fault.to_array(),
        };
        writeln!(truth, "{}", serde_json::to_string(&line)?).with_context(|| truth_path.display().to_string())?;
    }
    truth.flush().with_context(|| truth_path.display().to_string())?;
    Ok(Exit::Done)
}

/// `LOG.truth.jsonl` beside `LOG`.
fn truth_path(log: &Path) -> PathBuf {
    let mut name = log.as_os_str().to_owned();
    name.push(".truth.jsonl");
    PathBuf::from(name)
}

fn create(path: &Path) -> anyhow::Result<File> {
    File::create(path).with_context(|| path.display().to_string())
}

fn write_log(path: &Path, scenario: &Scenario, actuator: ActuatorId) -> anyhow::Result<()> {
    let mut names = BusNames::new();
    names.intern(INTERFACE)?;
    let frames = traffic(scenario, actuator, EPOCH_NS);
    match path.extension().and_then(|e| e.to_str()) {
        Some("mcap") => {
            let metadata = [
                ("build", concat!("hmd ", env!("CARGO_PKG_VERSION")).to_owned()),
                ("clock_source", "simulated".to_owned()),
                ("seed", scenario.seed.to_string()),
            ];
            let metadata = metadata.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
            let mut writer = McapWriter::new(SyncedFile::new(create(path)?), &metadata)
                .with_context(|| path.display().to_string())?;
            for frame in frames {
                writer
                    .write_frame(&frame, &names)
                    .with_context(|| path.display().to_string())?;
            }
            writer.finish().with_context(|| path.display().to_string())?;
        }
        Some("log") => {
            let mut file = BufWriter::new(create(path)?);
            let mut line = Vec::new();
            for frame in frames {
                line.clear();
                emit(&frame, INTERFACE, Decimals::Six, &mut line);
                file.write_all(&line).with_context(|| path.display().to_string())?;
            }
            file.flush().with_context(|| path.display().to_string())?;
        }
        _ => {
            let found = path.display();
            return Err(Misuse(format!("{found}: expected a name that ends in .mcap or .log")).into());
        }
    }
    Ok(())
}

fn fault_vector(args: &Args) -> anyhow::Result<FaultVector> {
    let mut k = FaultVector::NOMINAL.to_array();
    if !args.k.is_empty() {
        k = args
            .k
            .as_slice()
            .try_into()
            .map_err(|_| Misuse(format!("--k: expected {FAULT_COUNT} numbers, found {}", args.k.len())))?;
    }
    for &(index, value) in &args.fault {
        k[index] = value;
    }
    let fault = FaultVector::from_array(k);
    if let Some(p) = (0..FAULT_COUNT).find(|&p| !(0.0..=1.0).contains(&k[p])) {
        return Err(Misuse(format!(
            "{}: expected a number from 0 to 1, found {}",
            FaultVector::NAMES[p],
            k[p]
        ))
        .into());
    }
    Ok(fault)
}

fn named_fault(text: &str) -> Result<(usize, f64), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=K")?;
    let names = FaultVector::NAMES;
    let index = names
        .iter()
        .position(|n| *n == name)
        .ok_or_else(|| format!("expected one of {}", names.join(", ")))?;
    Ok((
        index,
        value
            .parse()
            .map_err(|_| format!("expected a number, found {value:?}"))?,
    ))
}

pub(super) fn named_profile(text: &str) -> Result<Profile, String> {
    let found = Profile::NAMES.into_iter().find(|(name, _)| *name == text);
    found
        .map(|(_, profile)| profile)
        .ok_or_else(|| "expected step, ramp, chirp or mixed".to_owned())
}

fn finite(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|x: &f64| x.abs() <= 1e6)
        .ok_or_else(|| "expected a number from -1e6 to 1e6".to_owned())
}

fn not_negative(text: &str) -> Result<f64, String> {
    finite(text).and_then(|x| {
        if x >= 0.0 {
            Ok(x)
        } else {
            Err("expected a number from 0 to 1e6".to_owned())
        }
    })
}

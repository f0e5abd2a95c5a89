//! What a bad link makes of verdicts: simulated windows through `firmware_sim`'s link faults and the whole chain, one by one
//! and without memory, in virtual time.

use std::collections::BTreeMap;
use std::sync::Arc;

use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::{ActuatorId, SerialPacket, Splitter};
use firmware_sim::{CanFrame, CanFrames, Link, LinkFaults, Plan, SerialFrames, StuckSensors, Timed};
use hmd_core::assess::{AssessedWindow, Assessor, Models};
use hmd_core::config::Config;
use hmd_core::frame::{BusNames, FrameFlags, RawFrame};
use hmd_core::pipeline::Pipeline;
use hmd_core::seed::mix;
use hmd_lab::simulate::EPOCH_NS;
use rayon::prelude::*;

/// Damage of a faulty window: between these, by its seed.
const DAMAGE: [f64; 2] = [0.1, 0.6];

/// Error class of a frame whose bits were wrong (`CAN_ERR_PROT` of `linux/can/error.h`).
const PROTOCOL_VIOLATION: u32 = 0x08;

/// Which link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Can,
    Serial,
}

/// What became of the windows.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tally {
    pub(crate) windows: u64,
    /// Identified: `ok` or `degraded`.
    pub(crate) assessed: u64,
    /// Of those, with exactly the true fault, or with none when there is none.
    pub(crate) right: u64,
    /// Of those, with a fault that is not there.
    pub(crate) false_faults: u64,
    /// Why the others were not assessed, without numbers.
    pub(crate) reasons: BTreeMap<String, u64>,
    /// AssessedWindow and not right: seed, truth and what was said.
    pub(crate) wrong: Vec<String>,
}

/// Watches `windows` actuations of as many units, each with the fault that `truth` gives for its number.
pub(crate) fn watch(
    kind: Kind,
    faults: LinkFaults,
    windows: u64,
    seed: u64,
    truth: impl Fn(u64) -> Option<(&'static str, FaultVector)> + Sync,
) -> Tally {
    let outcomes: Vec<_> = (0..windows)
        .into_par_iter()
        .map(|n| {
            let seed = mix(seed, &[n]);
            let (name, fault) = truth(n).unwrap_or(("", FaultVector::NOMINAL));
            (seed, name, one(&frames(kind, &scenario(fault, seed), faults, seed)))
        })
        .collect();
    let mut tally = Tally::default();
    for (seed, name, assessed) in outcomes {
        tally.add(seed, name, assessed.as_ref());
    }
    tally
}

/// Window n has one fault, each of the seven in turn, with a damage that its seed draws.
pub(crate) fn one_fault(seed: u64) -> impl Fn(u64) -> Option<(&'static str, FaultVector)> + Sync {
    const NAMED: [&str; 7] = [
        "friction",
        "backlash",
        "short_a",
        "short_b",
        "short_c",
        "eccentricity",
        "gain",
    ];
    move |n| {
        let place = |draw: u64| (mix(seed, &[n, draw]) >> 11) as f64 / (1_u64 << 53) as f64;
        let damage = DAMAGE[0] + (DAMAGE[1] - DAMAGE[0]) * place(1);
        let mut k = FaultVector::NOMINAL;
        let at = (n % 7) as usize;
        match at {
            0 => k.friction = damage,
            1 => k.backlash = damage,
            2 => k.short_a = damage,
            3 => k.short_b = damage,
            4 => k.short_c = damage,
            5 => (k.eccentricity, k.eccentricity_phase) = (damage, place(2)),
            _ => k.gain = 0.5 + 0.5 * if place(2) < 0.5 { damage } else { -damage },
        }
        Some((NAMED[at], k))
    }
}

impl Tally {
    fn add(&mut self, seed: u64, name: &str, assessed: Option<&AssessedWindow>) {
        self.windows += 1;
        let Some(health) = assessed.map(|assessed| &assessed.health) else {
            *self.reasons.entry("no window".to_owned()).or_default() += 1;
            return;
        };
        if health.estimate().is_none() {
            // Of an invalid window the reason begins with its kind; an unmodelled one has no other.
            let kind = health.reason.split(':').next().filter(|_| health.status == "invalid");
            let reason = kind.map_or(health.status.clone(), |kind| format!("invalid: {kind}"));
            *self.reasons.entry(reason).or_default() += 1;
            return;
        }
        self.assessed += 1;
        if health.faults == name {
            self.right += 1;
            return;
        }
        self.false_faults += u64::from(health.faults.split(',').any(|found| !found.is_empty() && found != name));
        self.wrong.push(format!(
            "seed {seed}, expected {name:?}, found {:?}: {} {:?}",
            health.faults,
            health.reason,
            health.estimate().map(|estimate| estimate.k)
        ));
    }
}

/// A `bench` unit at 2 kHz with 12-bit converters and 50 mA rms of noise, one mixed actuation after 60 ms of rest.
fn scenario(fault: FaultVector, seed: u64) -> Scenario {
    Scenario {
        sensing: CurrentSensing {
            quantised: true,
            noise_rms: 0.05,
        },
        actuations: Actuations {
            rest: 0.06,
            ..Actuations::single(Profile::Mixed)
        },
        ..Scenario::new(ActuatorParams::bench(), fault, seed)
    }
}

/// What arrives.
fn frames(kind: Kind, scenario: &Scenario, faults: LinkFaults, seed: u64) -> Vec<RawFrame> {
    let plan = Plan::new(ActuatorId::new(0).expect("0 to 15"), scenario.clone());
    let device = faults.with_stuck_sensors(plan.start(), seed);
    match kind {
        Kind::Can => over_can(device, faults, seed),
        Kind::Serial => over_serial(device, faults, seed),
    }
}

fn over_can(
    device: StuckSensors<impl Iterator<Item = Timed<SerialPacket>>>,
    faults: LinkFaults,
    seed: u64,
) -> Vec<RawFrame> {
    let received = |frame: Timed<CanFrame>| {
        let stamp_ns = EPOCH_NS + 1000 * frame.at_us;
        match frame.value {
            CanFrame::Data { id, data, .. } => RawFrame::new(stamp_ns, 0, id.into(), FrameFlags::NONE, &data),
            CanFrame::Error => RawFrame::new(stamp_ns, 0, PROTOCOL_VIOLATION, FrameFlags::ERROR, &[0; 8]),
        }
    };
    let frames = Link::new(CanFrames::new(device), faults, seed);
    frames
        .map(|frame| received(frame).expect("frames that exist"))
        .collect()
}

fn over_serial(
    device: StuckSensors<impl Iterator<Item = Timed<SerialPacket>>>,
    faults: LinkFaults,
    seed: u64,
) -> Vec<RawFrame> {
    let (mut splitter, mut frames): (Splitter, Vec<RawFrame>) = (Splitter::new(), Vec::new());
    for frame in Link::new(SerialFrames(device), faults, seed) {
        let stamp_ns = EPOCH_NS + 1000 * frame.at_us;
        for &byte in frame.value.bytes() {
            frames.extend(splitter.push(byte).map(|bytes| RawFrame::of_serial(stamp_ns, 0, bytes)));
        }
    }
    frames
}

/// The whole chain over the frames of one actuation of a unit of which every number is known; its first window.
fn one(frames: &[RawFrame]) -> Option<AssessedWindow> {
    let config = Config::from_toml_str("type.bench.tolerances = \"exact\"", "exact").expect("a configuration");
    let config = Arc::new(config);
    let mut names = BusNames::new();
    names.intern("bus0").expect("room for one bus");
    let mut pipeline = Pipeline::new(config.clone());
    for frame in frames {
        pipeline.push(frame, &names);
    }
    pipeline.finish();
    let job = pipeline.take_windows().into_iter().next()?;
    Some(
        Assessor::new(config.clone(), Models::without_files(&config).expect("no files"), 1)
            .assess(job)
            .expect("a usable configuration"),
    )
}

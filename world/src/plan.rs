//! What disturbs a run: a list from a seed, which can be shortened.

use std::fmt;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::disk::Mood;

/// Buses.
pub const BUSES: u16 = 2;
/// Actuators on each.
pub const DEVICES: u8 = 4;
/// Time without disturbances at the end, in which everything must work again.
pub const CALM: Duration = Duration::from_secs(12);
/// Longest disturbance.
pub const LASTS_MAX: Duration = Duration::from_secs(6);
/// Mean time between two disturbances.
const BETWEEN: Duration = Duration::from_millis(900);

/// What happens.
#[derive(Clone, Debug, PartialEq)]
pub enum What {
    /// Frames get lost, and nobody says so.
    Drop(u16, u32),
    /// The kernel drops frames, and counts them.
    Overflow(u16, u32),
    /// A bit of a frame is another.
    Flip(u16),
    /// A frame is shorter than its kind.
    Shorten(u16),
    /// Another device sends.
    Foreign(u16),
    /// A frame comes twice.
    Repeat(u16),
    /// Two frames come in the other order.
    Swap(u16),
    /// Frames are read late for a while.
    Jitter(u16, Duration),
    /// The controller is cut off for a while.
    BusOff(u16, Duration),
    /// The link is down for a while.
    LinkDown(u16, Duration),
    /// An actuator starts again.
    Reset(u16, u8),
    /// The disk behaves otherwise for a while.
    Disk(Mood, Duration),
    /// A bit of a closed segment is another.
    Rot,
    /// The power fails after so many operations on the disk.
    PowerCut(u64),
    /// The power fails now, and again at this change of names of the next start.
    PowerCutTwice(u64),
    /// The process is killed.
    Kill,
    /// The wall clock is set by so many ms.
    Step(i64),
    /// `SIGHUP`, with another configuration than before.
    ReloadGood,
    /// `SIGHUP`, with one that is wrong.
    ReloadBad,
    /// `SIGHUP`, without a file.
    ReloadAbsent,
    /// `SIGTERM`, and a new start.
    Restart,
    /// Identification takes long.
    Stall(Duration),
    /// A part is replaced, by the file of events.
    Maintenance(u16, u8),
}

impl What {
    /// Whether a run of the program ends by it.
    fn ends_run(&self) -> bool {
        matches!(
            self,
            Self::PowerCut(_) | Self::PowerCutTwice(_) | Self::Kill | Self::ReloadGood | Self::Restart
        )
    }
}

/// One disturbance.
#[derive(Clone, Debug, PartialEq)]
pub struct Disturbance {
    /// Its place in the list of its seed.
    pub number: usize,
    /// When.
    pub at: Duration,
    /// What.
    pub what: What,
}

impl fmt::Display for Disturbance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:4} {:8.3} s  {:?}", self.number, self.at.as_secs_f64(), self.what)
    }
}

/// A run of the world.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Of everything that the list does not say.
    pub seed: u64,
    /// Length of the run.
    pub length: Duration,
    /// In the order of time.
    pub disturbances: Vec<Disturbance>,
}

impl Plan {
    /// The run of a seed.
    #[must_use]
    pub fn of_seed(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let length = Duration::from_secs(rng.random_range(60..=120));
        let last = length - CALM - LASTS_MAX;
        // Some runs are quiet, so that long stretches without a break exist as well.
        let between = BETWEEN.mul_f64([0.5, 1.0, 3.0][rng.random_range(0..3)]);
        // In some nothing happens to the disk but power cuts, so that all can be replayed.
        let keeps_all = rng.random_bool(0.4);
        // In some the program runs from beginning to end, so that what takes long comes to its end as well.
        let ends_run = !rng.random_bool(0.3);
        // In some every sample that comes is as it was sent, so that all can be counted.
        let is_countable = rng.random_bool(0.3);
        let mut disturbances = Vec::new();
        let mut at = Duration::ZERO;
        loop {
            at += between.mul_f64(rng.random_range(0.0..2.0));
            if at > last {
                break;
            }
            let what = any(&mut rng);
            // An event may come to windows that were assessed already where the clock was set back: one of both.
            let is_odd = !seed.is_multiple_of(2);
            let is_of_disk = matches!(what, What::Disk(..) | What::Rot);
            if is_of_disk && keeps_all
                || what.ends_run() && !ends_run
                || matches!(what, What::Flip(_) | What::Reset(..)) && is_countable
                || matches!(what, What::Step(_)) && is_odd
                || matches!(what, What::Maintenance(..)) && !is_odd
            {
                continue;
            }
            let number = disturbances.len();
            disturbances.push(Disturbance { number, at, what });
        }
        Self {
            seed,
            length,
            disturbances,
        }
    }

    /// Whether the program stores no frames but those around windows that matter.
    #[must_use]
    pub fn captures(&self) -> bool {
        // Among those in which nobody sets the clock: stamps tell when a window was.
        self.seed % 10 == 3
    }

    /// The same with these disturbances alone.
    #[must_use]
    pub fn only(mut self, numbers: &[usize]) -> Self {
        self.disturbances.retain(|one| numbers.contains(&one.number));
        self
    }
}

fn any(rng: &mut ChaCha8Rng) -> What {
    let bus = rng.random_range(0..BUSES);
    let device = rng.random_range(0..DEVICES);
    let lasts = LASTS_MAX.mul_f64(rng.random_range(0.02..1.0));
    match rng.random_range(0..100) {
        0..14 => What::Drop(bus, rng.random_range(1..40)),
        14..20 => What::Overflow(bus, rng.random_range(1..200)),
        20..30 => What::Flip(bus),
        30..38 => What::Shorten(bus),
        38..43 => What::Foreign(bus),
        43..48 => What::Repeat(bus),
        48..53 => What::Swap(bus),
        53..58 => What::Jitter(bus, lasts),
        58..61 => What::BusOff(bus, lasts),
        61..64 => What::LinkDown(bus, lasts),
        64..68 => What::Reset(bus, device),
        68..71 => What::Disk(Mood::Full, lasts * rng.random_range(1..=3)),
        71..74 => What::Disk(Mood::Fails, lasts * rng.random_range(1..=3)),
        74..76 => What::Disk(Mood::Slow(Duration::from_millis(rng.random_range(5..400))), lasts),
        76..77 => What::Rot,
        77..79 => What::PowerCut(rng.random_range(1..60)),
        79..81 => What::PowerCutTwice(rng.random_range(1..12)),
        81..83 => What::Kill,
        83..87 => What::Step(rng.random_range(-5_000..5_000)),
        87..89 => What::ReloadGood,
        89..91 => What::ReloadBad,
        91..92 => What::ReloadAbsent,
        92..94 => What::Restart,
        94..97 => What::Stall(lasts * 3),
        _ => What::Maintenance(bus, device),
    }
}

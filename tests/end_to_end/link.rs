//! What a link does to frames on their way: seeded, and reproducible by the seed alone.

use hmd_core::frame::RawFrame;
use hmd_core::seed::mix;

/// Each frame is lost with this probability.
pub(crate) fn drop_frames(frames: Vec<RawFrame>, probability: f64, seed: u64) -> Vec<RawFrame> {
    let kept = |n: usize| uniform(seed, n) >= probability;
    frames
        .into_iter()
        .enumerate()
        .filter(|(n, _)| kept(*n))
        .map(|(_, frame)| frame)
        .collect()
}

/// Each frame arrives twice with this probability: CAN repeats one whose end only the sender saw disturbed.
pub(crate) fn repeat_frames(frames: Vec<RawFrame>, probability: f64, seed: u64) -> Vec<RawFrame> {
    let copies = |n: usize| if uniform(seed, n) < probability { 2 } else { 1 };
    frames
        .into_iter()
        .enumerate()
        .flat_map(|(n, frame)| std::iter::repeat_n(frame, copies(n)))
        .collect()
}

/// The receiver's clock runs at another rate than the device's, and each stamp is up to `jitter_ns` late.
pub(crate) fn drift(mut frames: Vec<RawFrame>, parts_per_million: f64, jitter_ns: u64, seed: u64) -> Vec<RawFrame> {
    let Some(first_ns) = frames.first().map(|frame| frame.stamp_ns) else {
        return frames;
    };
    for (n, frame) in frames.iter_mut().enumerate() {
        let since_first = (frame.stamp_ns - first_ns) as f64 * (1.0 + parts_per_million * 1e-6);
        let late = uniform(seed, n) * jitter_ns as f64;
        frame.stamp_ns = first_ns + (since_first + late).round() as u64;
    }
    frames
}

/// Two devices on one bus: by stamp, the first one's frame first where both have the same.
pub(crate) fn merge(a: Vec<RawFrame>, b: Vec<RawFrame>) -> Vec<RawFrame> {
    let mut both: Vec<RawFrame> = a.into_iter().chain(b).collect();
    both.sort_by_key(|frame| frame.stamp_ns);
    both
}

/// All frames of one sample but the status are lost.
pub(crate) fn lose_sample(mut frames: Vec<RawFrame>, sample: usize) -> Vec<RawFrame> {
    let numbers = sample_numbers(&frames);
    let mut n = 0;
    frames.retain(|frame| {
        n += 1;
        numbers[n - 1] != sample || frame.id() & 0xF == STATUS
    });
    frames
}

/// One bit of the resolver's count arrives wrong.
pub(crate) fn flip_position_bit(frames: Vec<RawFrame>, sample: usize, bit: usize) -> Vec<RawFrame> {
    let numbers = sample_numbers(&frames);
    let garble = |(frame, number): (RawFrame, usize)| {
        if number == sample && frame.id() & 0xF == POSITION {
            with_data(&frame, |data| data[bit / 8] ^= 1 << (bit % 8))
        } else {
            frame
        }
    };
    frames.into_iter().zip(numbers).map(garble).collect()
}

/// One byte of every status frame has this value.
pub(crate) fn set_status_byte(frames: Vec<RawFrame>, byte: usize, value: u8) -> Vec<RawFrame> {
    let garble = |frame: RawFrame| {
        if frame.id() & 0xF == STATUS {
            with_data(&frame, |data| data[byte] = value)
        } else {
            frame
        }
    };
    frames.into_iter().map(garble).collect()
}

/// Offsets of the dictionary's messages.
const POSITION: u32 = 1;
const STATUS: u32 = 3;

/// The sample that each frame belongs to: the currents come first.
fn sample_numbers(frames: &[RawFrame]) -> Vec<usize> {
    let mut begun = 0;
    let count = |frame: &RawFrame| {
        begun += usize::from(frame.id() & 0xF == 0);
        begun.saturating_sub(1)
    };
    frames.iter().map(count).collect()
}

fn with_data(frame: &RawFrame, change: impl FnOnce(&mut [u8])) -> RawFrame {
    let mut data = frame.data().to_vec();
    change(&mut data);
    RawFrame::new(frame.stamp_ns, frame.bus, frame.id(), frame.flags(), &data).expect("as long as before")
}

/// A number in [0, 1) for frame n.
fn uniform(seed: u64, n: usize) -> f64 {
    (mix(seed, &[n as u64]) >> 11) as f64 / (1_u64 << 53) as f64
}

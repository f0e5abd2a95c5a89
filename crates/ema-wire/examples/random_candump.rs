//! Prints a candump log of random actuator frames, some of them invalid: `random_candump [FRAMES] [SEED]`.

use ema_wire::can::{CLASSIC_LEN, FD_LEN};
use ema_wire::{ActuatorId, Message, SampleFd};

fn main() {
    let mut arguments = std::env::args()
        .skip(1)
        .map(|text| text.parse::<u64>().expect("a number"));
    let frames = arguments.next().unwrap_or(1_000);
    let mut random = SplitMix64(arguments.next().unwrap_or(1));
    for k in 0..frames {
        let actuator = ActuatorId::new(random.below(16)).expect("below 16");
        let message = Message::ALL[usize::from(random.below(5))];
        let (len, separator) = if message == Message::SampleFd {
            (FD_LEN, "##1")
        } else {
            (CLASSIC_LEN, "#")
        };
        let mut data: Vec<u8> = (0..len).map(|_| random.below(255) + random.below(2)).collect();
        // Random bytes; those with a constrained range are valid most of the time.
        match message {
            Message::Command => data[4] = random.below(3),
            Message::SampleFd => {
                (data[2], data[3]) = (1 + random.below(3), SampleFd::LAYOUT);
                for slot in data[4..].chunks_exact_mut(20) {
                    slot[13] = random.below(3);
                }
            }
            Message::Status if random.below(4) == 0 => (data[4], data[5]) = (0x00, 0x80),
            _ => {}
        }
        if random.below(50) == 0 {
            let at = usize::from(random.below(255)) % len;
            data[at] = 0xff;
        }
        let hex: String = data.iter().map(|byte| format!("{byte:02X}")).collect();
        println!(
            "({}.{:06}) can0 {:03X}{separator}{hex}",
            k / 1_000_000,
            k % 1_000_000,
            message.id(actuator)
        );
    }
}

/// SplitMix64 of Steele, Lea and Flood (2014): good enough for test bytes, without a dependency.
struct SplitMix64(u64);

impl SplitMix64 {
    fn below(&mut self, bound: u8) -> u8 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % u64::from(bound)) as u8
    }
}

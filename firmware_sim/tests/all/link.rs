//! The effect of each link fault, and its reproducibility by the seed.

use ema_wire::can::{Currents, Position};
use ema_wire::{ActuatorId, Deframer, Message, Mode, Sample, SerialPacket};
use firmware_sim::{CanFrame, CanFrames, Link, LinkFaults, LinkFrame, SerialFrames, Timed};

const PACKETS: u64 = 20_000;

/// Samples of an actuator in steady motion, 500 µs apart.
fn packets() -> impl Iterator<Item = Timed<SerialPacket>> {
    (0..PACKETS).map(|n| Timed {
        at_us: 500 * n,
        value: SerialPacket::Sample(Sample {
            actuator: ActuatorId::new(0).expect("0 to 15"),
            seq: n as u16,
            time_us: (500 * n) as u16,
            i_a_ma: (n % 997) as i16,
            i_b_ma: -((n % 503) as i16),
            i_c_ma: 7,
            motor_counts: 40 * n as i32,
            output_counts: n as i32,
            setpoint: 250_000,
            mode: Mode::Position,
        }),
    })
}

fn transmitted<F: LinkFrame>(frames: impl Iterator<Item = Timed<F>>, faults: LinkFaults, seed: u64) -> Vec<Timed<F>> {
    Link::new(frames, faults, seed).collect()
}

/// Asserts that a count agrees with a probability within five standard deviations.
fn assert_share(count: usize, n: usize, probability: f64) {
    let (expected, spread) = (
        n as f64 * probability,
        5.0 * (n as f64 * probability * (1.0 - probability)).sqrt(),
    );
    assert!(
        (count as f64 - expected).abs() < spread,
        "{count} of {n}, expected {expected}"
    );
}

#[test]
fn a_perfect_link_changes_nothing() {
    let sent: Vec<_> = SerialFrames(packets()).collect();
    assert_eq!(transmitted(sent.iter().copied(), LinkFaults::NONE, 1), sent);
    let sent: Vec<_> = CanFrames::new(packets()).collect();
    assert_eq!(transmitted(sent.iter().copied(), LinkFaults::NONE, 1), sent);
    assert_eq!(
        LinkFaults::NONE.with_stuck_sensors(packets(), 1).count() as u64,
        PACKETS
    );
    assert!(LinkFaults::NONE.with_stuck_sensors(packets(), 1).eq(packets()));
}

#[test]
fn the_seed_determines_the_faults() {
    let arrived = |seed| transmitted(CanFrames::new(packets()), LinkFaults::WORST, seed);
    assert_eq!(arrived(3), arrived(3));
    assert_ne!(arrived(3), arrived(4));
}

#[test]
fn drops_and_duplicates_have_their_probabilities() {
    let drop = LinkFaults {
        drop: 0.03,
        ..LinkFaults::NONE
    };
    let n = PACKETS as usize;
    assert_share(n - transmitted(SerialFrames(packets()), drop, 5).len(), n, 0.03);
    let duplicate = LinkFaults {
        duplicate: 0.03,
        ..LinkFaults::NONE
    };
    let arrived = transmitted(SerialFrames(packets()), duplicate, 5);
    assert_share(arrived.len() - n, n, 0.03);
    assert_share(arrived.windows(2).filter(|pair| pair[0] == pair[1]).count(), n, 0.03);
}

#[test]
fn a_reordered_frame_changes_places_with_the_next() {
    let reorder = LinkFaults {
        reorder: 0.1,
        ..LinkFaults::NONE
    };
    let sent: Vec<_> = SerialFrames(packets()).map(|frame| frame.value).collect();
    let arrived = transmitted(SerialFrames(packets()), reorder, 5);
    assert!(
        arrived.windows(2).all(|pair| pair[0].at_us <= pair[1].at_us),
        "in the order of time"
    );
    let arrived: Vec<_> = arrived.into_iter().map(|frame| frame.value).collect();
    assert_eq!(arrived.len(), sent.len());
    let (mut n, mut swaps) = (0, 0);
    while n < sent.len() {
        if arrived[n] != sent[n] {
            assert_eq!((arrived[n], arrived[n + 1]), (sent[n + 1], sent[n]), "frame {n}");
            swaps += 1;
            n += 1;
        }
        n += 1;
    }
    // A frame that has overtaken another is not overtaken itself.
    assert_share(swaps, sent.len() - swaps, 0.1);
}

#[test]
fn the_crc_of_the_line_detects_every_flip() {
    let flip = LinkFaults {
        flip: 0.05,
        ..LinkFaults::NONE
    };
    let mut deframer = Deframer::new();
    let mut received = Vec::new();
    for frame in transmitted(SerialFrames(packets()), flip, 5) {
        received.extend(deframer.push_slice(frame.value.bytes()));
    }
    let mut sent = packets().map(|timed| timed.value);
    assert!(
        received.iter().all(|packet| sent.any(|other| other == *packet)),
        "every received packet was sent"
    );
    let lost = PACKETS as usize - received.len();
    // A flipped zero at the end of a frame also destroys the next frame.
    assert!(
        (900..1300).contains(&lost) && deframer.stats().dropped() > 900,
        "{lost}, {:?}",
        deframer.stats()
    );
}

#[test]
fn a_flip_on_the_bus_is_an_error_frame_or_a_large_error_of_a_value() {
    let flip = LinkFaults {
        flip: 1.0,
        ..LinkFaults::NONE
    };
    let sent: Vec<_> = CanFrames::new(packets()).map(|frame| frame.value).collect();
    let arrived = transmitted(CanFrames::new(packets()), flip, 5);
    let (mut errors, mut values) = (0, 0);
    for (sent, arrived) in sent.iter().zip(arrived) {
        match (sent, arrived.value) {
            (_, CanFrame::Error) => errors += 1,
            (CanFrame::Data { data: before, .. }, CanFrame::Data { data, message, .. }) => {
                values += 1;
                match message {
                    Message::Currents => {
                        let (was, is) = (Currents::parse(before), Currents::parse(&data));
                        let off = |was: i16, is: i16| u16::abs_diff(was.cast_unsigned(), is.cast_unsigned());
                        let off = off(was.i_a_ma, is.i_a_ma)
                            .max(off(was.i_b_ma, is.i_b_ma))
                            .max(off(was.i_c_ma, is.i_c_ma));
                        assert!(off >= 1000 && was.seq == is.seq, "{off} mA");
                    }
                    Message::Position => {
                        let (was, is) = (Position::parse(before), Position::parse(&data));
                        let off = was
                            .motor_counts
                            .abs_diff(is.motor_counts)
                            .max(was.output_counts.abs_diff(is.output_counts));
                        assert!(off >= 50 && was.seq8 == is.seq8, "{off} counts");
                    }
                    other => panic!("expected a value of currents or positions, found {other:?}"),
                }
            }
            (CanFrame::Error, CanFrame::Data { .. }) => panic!("expected an error frame to stay one"),
        }
    }
    // All command frames, and half of the others.
    assert_share(errors, sent.len(), 2.0 / 3.0);
    assert_eq!(errors + values, sent.len());
}

#[test]
fn a_stuck_signal_is_constant_and_the_others_change() {
    let faults = LinkFaults {
        stuck: 0.01,
        ..LinkFaults::NONE
    };
    let sample_in = |packet: SerialPacket| match packet {
        SerialPacket::Sample(sample) => sample,
        SerialPacket::Status { .. } => panic!("samples only"),
    };
    let truth: Vec<Sample> = packets().map(|timed| sample_in(timed.value)).collect();
    let seen: Vec<Sample> = faults
        .with_stuck_sensors(packets(), 5)
        .map(|timed| sample_in(timed.value))
        .collect();
    let mut stuck = [0; 3];
    for n in 1..truth.len() {
        let (was, is, before) = (&truth[n], &seen[n], &seen[n - 1]);
        assert_eq!((was.seq, was.time_us, was.setpoint), (is.seq, is.time_us, is.setpoint));
        let wrong = [
            (was.i_a_ma, was.i_b_ma) != (is.i_a_ma, is.i_b_ma),
            was.motor_counts != is.motor_counts,
            was.output_counts != is.output_counts,
        ];
        assert!(wrong.iter().filter(|wrong| **wrong).count() <= 1);
        let repeated = [
            is.i_a_ma == before.i_a_ma,
            is.motor_counts == before.motor_counts,
            is.output_counts == before.output_counts,
        ];
        for signal in 0..3 {
            assert!(!wrong[signal] || repeated[signal], "sample {n}, signal {signal}");
            stuck[signal] += usize::from(wrong[signal]);
        }
    }
    // A signal becomes stuck at one sample in a hundred, for 4.5 samples on average.
    for count in stuck {
        assert!((200..400).contains(&count), "{stuck:?}");
    }
}

#[test]
fn a_fast_clock_shortens_the_times_and_a_delay_lengthens_them() {
    let last = |faults| {
        transmitted(SerialFrames(packets()), faults, 5)
            .last()
            .expect("frames")
            .at_us
    };
    let on_time = last(LinkFaults::NONE);
    let drifted = last(LinkFaults {
        drift_ppm: 100.0,
        ..LinkFaults::NONE
    });
    assert!(
        (on_time - drifted).abs_diff(on_time / 10_000) <= 1,
        "{on_time} {drifted}"
    );
    let delayed = transmitted(
        SerialFrames(packets()),
        LinkFaults {
            delay_us: 3000,
            ..LinkFaults::NONE
        },
        5,
    );
    let late: Vec<u64> = delayed
        .iter()
        .zip(packets())
        .map(|(is, was)| is.at_us - was.at_us)
        .collect();
    assert!(late.iter().all(|late| *late <= 3000) && late.iter().any(|late| *late > 2000));
    assert!(delayed.windows(2).all(|pair| pair[0].at_us <= pair[1].at_us));
}

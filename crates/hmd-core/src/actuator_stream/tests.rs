use super::*;

/// An actuator at 400 Hz.
fn stream() -> ActuatorStream {
    let rate = "[type.bench.sensors]\nsample_rate_hz = 400\n";
    let config = Config::from_toml_str(rate, "hmd.toml").expect("a good configuration");
    ActuatorStream::new(Arc::new(config.actuators()[0].clone()), &config)
}

/// The sample of a number, at rest.
fn at_rest(stream: &ActuatorStream, n: u16) -> Sample {
    Sample {
        actuator: stream.actuator.id,
        seq: n,
        time_us: n.wrapping_mul(2500),
        i_a_ma: 0,
        i_b_ma: 0,
        i_c_ma: 0,
        motor_counts: 0,
        output_counts: 0,
        setpoint: 0,
        mode: Mode::Idle,
    }
}

/// Frames of a 400 Hz stream whose last sample takes `torn_ns` to come in; how many samples came out.
fn delivered(torn_ns: u64) -> usize {
    let mut stream = stream();
    let mut outbox = Outbox::collecting_samples();
    for n in 0..40_u16 {
        let sample = at_rest(&stream, n);
        let sent_ns = u64::from(n) * 2_500_000;
        let torn_ns = if n == 39 { torn_ns } else { 0 };
        for (place, frame) in sample.to_frames().iter().enumerate() {
            let stamp_ns = sent_ns + if place == 0 { 0 } else { torn_ns };
            stream.push(frame, stamp_ns, &mut outbox);
        }
    }
    outbox.take_samples().len()
}

#[test]
fn a_stalled_receiver_splits_no_sample() {
    assert_eq!(delivered(0), 40);
    assert_eq!(delivered(79_000_000), 40, "32 periods of 2.5 ms");
    assert_eq!(delivered(81_000_000), 39);
}

/// What is told of a device that counts from 0 again so long after its last sample, and how many samples came out.
fn told_of_restart_after(silence_ns: u64) -> (Vec<String>, usize) {
    let mut stream = stream();
    let mut outbox = Outbox::collecting_samples();
    let mut sent_ns = 0;
    for n in (1000..1040).chain(0..40) {
        sent_ns += if n == 0 { silence_ns } else { 2_500_000 };
        for frame in at_rest(&stream, n).to_frames() {
            stream.push(&frame, sent_ns, &mut outbox);
        }
    }
    let told = outbox.take_notices().into_iter().map(|notice| notice.message);
    (told.collect(), outbox.take_samples().len())
}

#[test]
fn a_counter_that_begins_anew_is_news_unless_the_actuator_was_off() {
    let (told, samples) = told_of_restart_after(OFF_NS - 1);
    assert_eq!(
        told,
        ["ema0: expected a sample counter that rises, found one that went back; an open window is cut short"]
    );
    assert_eq!(samples, 80);
    let (told, samples) = told_of_restart_after(OFF_NS);
    assert_eq!((told, samples), (Vec::new(), 80), "it was off");
}

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

/// A device with what it sends next: counter, time, set point.
struct Device {
    counter: u16,
    at_us: u64,
    period_us: u64,
    setpoint: i32,
}

impl Device {
    const fn new(counter: u16, period_us: u64) -> Self {
        Self {
            counter,
            at_us: 0,
            period_us,
            setpoint: 0,
        }
    }

    /// Sends so many samples; the set point jumps at the sample `jump`.
    fn send(&mut self, stream: &mut ActuatorStream, outbox: &mut Outbox, samples: u64, jump: u64) {
        for n in 0..samples {
            if n == jump {
                self.setpoint = 300_000 - self.setpoint;
            }
            let sample = Sample {
                seq: self.counter,
                time_us: self.at_us as u16,
                setpoint: self.setpoint,
                mode: Mode::Position,
                ..at_rest(stream, 0)
            };
            for frame in sample.to_frames() {
                stream.push(&frame, 1_700_000_000_000_000_000 + 1000 * self.at_us, outbox);
            }
            self.counter = self.counter.wrapping_add(1);
            self.at_us += self.period_us;
        }
    }
}

/// The numbers of windows, their samples by length, their rates, and the notices.
fn cut(outbox: &mut Outbox) -> (Vec<(u64, usize, f64)>, Vec<String>) {
    let windows = outbox.take_windows().into_iter();
    let windows = windows.map(|job| (job.window.number, job.window.expected, job.params.sensors.sample_rate));
    let notices = outbox.take_notices().into_iter().map(|notice| notice.message);
    (windows.collect(), notices.collect())
}

#[test]
fn a_device_that_comes_back_at_another_rate_is_cut_at_that_rate() {
    for (counter, silence_us) in [(0, 3_000_000), (500, 2_500)] {
        let (mut stream, mut outbox) = (stream(), Outbox::default());
        let mut device = Device::new(0, 2_500);
        device.send(&mut stream, &mut outbox, 500, 200);
        assert_eq!(cut(&mut outbox).0.len(), 1);
        // Reflashed to 2 kHz; with or without a restart.
        (device.counter, device.period_us) = (counter, 500);
        device.at_us += silence_us;
        device.send(&mut stream, &mut outbox, 2_500, 1_000);
        let (windows, notices) = cut(&mut outbox);
        assert_eq!(windows.len(), 1);
        assert_eq!((windows[0].0, windows[0].1), (1, 1001), "numbers go on");
        assert!((windows[0].2 - 2000.0).abs() < 1e-9);
        let changed = "ema0: the sample rate changed from 400.0 to 2000.0 samples/s by the device's time; an open window is cut short";
        assert!(notices.contains(&changed.to_owned()), "{notices:?}");
        // And back.
        (device.counter, device.period_us) = (0, 2_500);
        device.at_us += 3_000_000;
        device.send(&mut stream, &mut outbox, 500, 200);
        let (windows, _) = cut(&mut outbox);
        assert_eq!((windows.len(), windows[0].0, windows[0].1), (1, 2, 201));
        let counts = StreamCounts {
            lost: 0,
            restarts: if counter == 0 { 2 } else { 1 },
            rate_changes: 2,
        };
        assert_eq!(stream.counts(), counts);
    }
}

#[test]
fn another_recording_has_a_rate_and_conditions_of_its_own() {
    let (mut stream, mut outbox) = (stream(), Outbox::default());
    // Too few samples to show their rate.
    Device::new(0, 2_600).send(&mut stream, &mut outbox, 10, 10);
    stream.conditions.load_torque_nm = Some(30.0);
    stream.finish(&mut outbox);
    for (period_us, rate_hz) in [(2_600, 384.615_384_615), (2_500, 400.0), (2_500, 400.0)] {
        stream.begin_recording();
        Device::new(0, period_us).send(&mut stream, &mut outbox, 500, 200);
        stream.finish(&mut outbox);
        let windows = outbox.take_windows();
        let [job] = windows.as_slice() else {
            panic!("{} windows", windows.len());
        };
        assert_eq!((job.window.number, job.conditions.load_torque_nm), (0, None));
        let found_hz = job.params.sensors.sample_rate;
        assert!((found_hz - rate_hz).abs() < 1e-6, "{found_hz}");
    }
    let notices = outbox.take_notices();
    let of_rate = notices.iter().filter(|notice| notice.message.contains("found 384.6"));
    assert_eq!(of_rate.count(), 1, "{notices:?}");
}

#[test]
fn a_window_in_which_the_rate_changes_says_so() {
    let (mut stream, mut outbox) = (stream(), Outbox::default());
    let mut device = Device::new(0, 2_500);
    device.send(&mut stream, &mut outbox, 250, 200);
    device.period_us = 1_000;
    device.send(&mut stream, &mut outbox, 100, 100);
    let windows = outbox.take_windows();
    let [job] = windows.as_slice() else {
        panic!("{} windows", windows.len());
    };
    assert_eq!(job.window.quality.to_string(), "cut short: sample rate changed");
}

#[test]
fn a_refused_rate_is_left_again() {
    let (mut stream, mut outbox) = (stream(), Outbox::default());
    let mut device = Device::new(0, 270);
    device.send(&mut stream, &mut outbox, 500, 500);
    let (_, notices) = cut(&mut outbox);
    assert!(
        notices.iter().any(|notice| notice.contains("not monitored")),
        "{notices:?}"
    );
    (device.counter, device.period_us) = (0, 2_500);
    device.at_us += 1_000_000;
    device.send(&mut stream, &mut outbox, 500, 200);
    assert_eq!(cut(&mut outbox).0.len(), 1);
    assert!((500..=548).contains(&stream.counts().lost), "{:?}", stream.counts());
}

#[test]
fn a_restart_beyond_half_the_counter_is_no_loss() {
    let (mut stream, mut outbox) = (stream(), Outbox::default());
    let mut device = Device::new(40_000, 2_500);
    device.send(&mut stream, &mut outbox, 300, 300);
    device.counter = 0;
    device.at_us += 4_000_000;
    device.send(&mut stream, &mut outbox, 300, 300);
    let restarted = StreamCounts {
        lost: 0,
        restarts: 1,
        rate_changes: 0,
    };
    assert_eq!(stream.counts(), restarted);
    let (_, notices) = cut(&mut outbox);
    assert_eq!(
        notices,
        ["ema0: expected a sample counter that rises, found one that went back; an open window is cut short"]
    );
    // 100 s without a bus, while the device counts on.
    device.counter += 40_000;
    device.at_us += 100_000_000;
    device.send(&mut stream, &mut outbox, 300, 300);
    let lost = StreamCounts {
        lost: 40_000,
        ..restarted
    };
    assert_eq!(stream.counts(), lost);
}

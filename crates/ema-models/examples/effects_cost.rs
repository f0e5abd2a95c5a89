//! Prints what effects cost: the time of a window of the reference model, plain and with effects, alternating in one run.
//!
//! `cargo run --release -p ema-models --features std --example effects_cost`

#[cfg(feature = "std")]
fn main() {
    use std::time::Instant;

    use ema_models::reference::{Drive, EFFECTS, Effects, Scenario};
    use ema_models::{ActuatorParams, FaultVector};

    let params = ActuatorParams::bench();
    let fault = FaultVector {
        short_a: 0.2,
        ..FaultVector::NOMINAL
    };
    let mut everything = Effects::default();
    for info in EFFECTS {
        let (min, max) = info.usual_on(&params);
        let value = if info.whole { max } else { 0.25 * min + 0.75 * max };
        everything.set(info.name, value).expect("a usual value can be set");
    }
    let cases = [
        ("plain", Effects::default()),
        (
            "vector drive",
            Effects {
                drive: Drive::from_name("vector").expect("a kind of drive"),
                ..Effects::default()
            },
        ),
        (
            "everything, hysteresis drive",
            Effects {
                drive: Drive::Hysteresis,
                ..everything
            },
        ),
        ("everything, vector drive", everything),
    ];
    let mut best = [f64::INFINITY; 4];
    for round in 0..11 {
        for (slot, (_, effects)) in best.iter_mut().zip(&cases) {
            let mut scenario = Scenario::new(params, fault, round);
            scenario.effects = *effects;
            let start = Instant::now();
            let counts: i64 = scenario.run().map(|sample| sample.motor_counts).sum();
            let time = start.elapsed().as_secs_f64();
            assert!(counts != 0);
            *slot = slot.min(time);
        }
    }
    for ((name, _), time) in cases.iter().zip(best) {
        println!("{name}: {:.1} ms, {:.2} of plain", 1e3 * time, time / best[0]);
    }
}

#[cfg(not(feature = "std"))]
fn main() {
    eprintln!("needs `--features std`");
}

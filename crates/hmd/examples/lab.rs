//! lab
use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::*;
use hmd::calibrate::random_faults;
use hmd::calibration::{MonitorForm, TypeCalibration};
use hmd::identify::*;
use hmd::simulated::SimulatedWindow;
use rayon::prelude::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (act, prof, rate, noise, load, healthy, n) = (
        &a[1],
        &a[2],
        a[3].parse::<f64>().unwrap(),
        a[4].parse::<f64>().unwrap(),
        a[5].parse::<f64>().unwrap(),
        &a[6] == "h",
        a[7].parse::<u64>().unwrap(),
    );
    let mut params = if act == "bench" {
        ActuatorParams::bench()
    } else {
        ActuatorParams::servo28()
    };
    params.sensors.sample_rate = rate;
    let id = Identifier {
        params,
        calibration: TypeCalibration::built_in(act, MonitorForm::ThreePhase).unwrap(),
        method: Method::hybrid(),
        motor: MotorKnowledge {
            mean: MotorDeviation {
                resistance: std::env::var("DR").map_or(0.0, |v| v.parse().unwrap()),
                back_emf: std::env::var("DK").map_or(0.0, |v| v.parse().unwrap()),
            },
            covariance: [[0.0; 2]; 2],
        },
    };
    let profile = match prof.as_str() {
        "step" => Profile::Step,
        "ramp" => Profile::Ramp,
        "chirp" => Profile::Chirp,
        _ => Profile::Mixed,
    };
    let rows: Vec<_> = (0..n)
        .into_par_iter()
        .map(|i| {
            let truth = if healthy {
                FaultVector::NOMINAL
            } else {
                random_faults(1000 + i)
            };
            let s = Scenario {
                sensing: CurrentSensing {
                    quantised: noise > 0.0,
                    noise_rms: noise,
                },
                load_torque: if load != 0.0 {
                    load * (i as f64 / n as f64 * 2.0 - 1.0)
                } else {
                    0.0
                },
                actuations: Actuations::one(profile),
                ..Scenario::new(params, truth, 7000 + i)
            };
            let mut w = SimulatedWindow::of(&s);
            if load < 0.0 {
                w.conditions.load_torque = None;
            }
            let e = id.identify(&w.prepared, w.conditions, i).unwrap();
            let (k, t) = (e.fault.to_array(), truth.to_array());
            if std::env::var("SHOW").is_ok() && (k[0] - t[0]).abs() > 0.015 {
                let co = id.calibration.coefficients();
                let c = id.comparison(&w.prepared, &co, w.conditions);
                println!(
                    "{i} dk1 {:+.4} truth {t:.2?} load {:?} {:.2} integral {:.3} cost {:.2} at truth {:.2}",
                    k[0] - t[0],
                    w.conditions.load_torque,
                    e.unknowns.load_torque,
                    e.unknowns.integral,
                    e.cost,
                    c.least_squares(&Unknowns {
                        load_torque: s.load_torque,
                        ..c.with_fault(truth)
                    })
                );
            }
            (
                core::array::from_fn::<f64, 8, _>(|p| k[p] - t[p]),
                e.sigma,
                rss_pct(&e.fault, &truth),
                e.cost,
            )
        })
        .collect();
    for p in 0..8 {
        let v: Vec<f64> = rows.iter().map(|r| r.0[p]).collect();
        let m = v.iter().sum::<f64>() / n as f64;
        let sd = (v.iter().map(|x| (x - m).powi(2)).sum::<f64>() / n as f64).sqrt();
        let worst = v.iter().fold(0.0f64, |a, x| if x.abs() > a.abs() { *x } else { a });
        let sg: Vec<f64> = rows.iter().filter_map(|r| r.1[p]).collect();
        let z = rows
            .iter()
            .filter(|r| r.1[p].is_some_and(|s| r.0[p].abs() <= 1.96 * s))
            .count();
        println!(
            "k{} mean {m:+.4} sd {sd:.4} worst {worst:+.4} sigma {:.4} cover {:.2} of {}",
            p + 1,
            sg.iter().sum::<f64>() / sg.len() as f64,
            z as f64 / sg.len() as f64,
            sg.len()
        );
    }
    let mut r: Vec<f64> = rows.iter().map(|r| r.2).collect();
    r.sort_by(f64::total_cmp);
    println!(
        "rss median {:.2} p95 {:.2} max {:.2}; cost max {:.2}",
        r[r.len() / 2],
        r[r.len() * 95 / 100],
        r[r.len() - 1],
        rows.iter().map(|r| r.3).fold(0.0, f64::max)
    );
}

//! lab: unit calibration
use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::*;
use hmd::calibration::{MonitorForm, TypeCalibration};
use hmd::identify::*;
use hmd::simulated::SimulatedWindow;
use hmd::unit::fit_motor;
use rayon::prelude::*;
fn u(seed: u64, n: u64) -> f64 {
    (hmd::seed::mix(seed, &[n]) >> 11) as f64 / (1u64 << 53) as f64
}
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (act, rate, noise, load, n) = (
        &a[1],
        a[2].parse::<f64>().unwrap(),
        a[3].parse::<f64>().unwrap(),
        a[4].parse::<f64>().unwrap(),
        a[5].parse::<u64>().unwrap(),
    );
    let mut params = if act == "bench" {
        ActuatorParams::bench()
    } else {
        ActuatorParams::servo28()
    };
    params.sensors.sample_rate = rate;
    let tol = MotorKnowledge {
        mean: MotorDeviation::default(),
        covariance: [[0.03f64.powi(2), 0.0], [0.0, 0.02f64.powi(2)]],
    };
    let id = Identifier {
        params,
        calibration: TypeCalibration::built_in(act, MonitorForm::ThreePhase).unwrap(),
        method: Method::hybrid(),
        motor: tol,
    };
    let co = id.calibration.coefficients();
    let rows: Vec<_> = (0..n)
        .into_par_iter()
        .map(|i| {
            let (dr, dk) = ((u(i, 1) - 0.5) * 0.1, (u(i, 2) - 0.5) * 0.06);
            let mut unit = params;
            unit.motor.r_s *= 1.0 + dr;
            unit.motor.k *= 1.0 + dk;
            let ws: Vec<SimulatedWindow> = (0..5)
                .map(|w| {
                    let s = Scenario {
                        unit,
                        sensing: CurrentSensing {
                            quantised: noise > 0.0,
                            noise_rms: noise,
                        },
                        load_torque: load * (2.0 * u(i, 10 + w) - 1.0),
                        ..Scenario::new(params, FaultVector::NOMINAL, hmd::seed::mix(i, &[99, w]))
                    };
                    let mut w = SimulatedWindow::of(&s);
                    if load != 0.0 {
                        w.conditions.load_torque = None;
                    }
                    w
                })
                .collect();
            let cs: Vec<_> = ws
                .iter()
                .map(|w| id.comparison(&w.prepared, &co, w.conditions))
                .collect();
            let f = fit_motor(&cs).unwrap();
            (
                f.motor.mean.resistance - dr,
                f.motor.mean.back_emf - dk,
                f.motor.covariance[0][0].sqrt(),
                f.motor.covariance[1][1].sqrt(),
                f.cost,
            )
        })
        .collect();
    let st = |v: Vec<f64>| {
        let m = v.iter().sum::<f64>() / n as f64;
        (m, (v.iter().map(|x| (x - m).powi(2)).sum::<f64>() / n as f64).sqrt())
    };
    println!(
        "R mean sd {:?} sigma {:?}",
        st(rows.iter().map(|r| r.0).collect()),
        st(rows.iter().map(|r| r.2).collect())
    );
    println!(
        "k mean sd {:?} sigma {:?}",
        st(rows.iter().map(|r| r.1).collect()),
        st(rows.iter().map(|r| r.3).collect())
    );
    println!("cost {:?}", st(rows.iter().map(|r| r.4).collect()));
}

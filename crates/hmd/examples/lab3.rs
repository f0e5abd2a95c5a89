//! lab: residual at truth
use ema_models::reference::{Actuations, Scenario};
use ema_models::*;
use hmd::calibration::{MonitorForm, TypeCalibration};
use hmd::identify::*;
use hmd::simulated::SimulatedWindow;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (rate, seed) = (a[1].parse::<f64>().unwrap(), a[2].parse::<u64>().unwrap());
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = rate;
    let id = Identifier {
        params,
        calibration: TypeCalibration::built_in("bench", MonitorForm::ThreePhase).unwrap(),
        method: Method::hybrid(),
        motor: MotorKnowledge::default(),
    };
    let s = Scenario {
        actuations: Actuations::one(Profile::Mixed),
        ..Scenario::new(params, FaultVector::NOMINAL, seed)
    };
    let w = SimulatedWindow::of(&s);
    let co = id.calibration.coefficients();
    let c = id.comparison(&w.prepared, &co, w.conditions);
    let mut last = 0.0;
    c.residuals(&c.with_fault(FaultVector::NOMINAL), |n, r| {
        let x = &c.recording.samples[n];
        let sp = match x.setpoint {
            Setpoint::Position(p) => p,
            _ => 0.0,
        };
        println!(
            "{:.4} sp {:+.5} iq {:+.3} r {:+.3} om {:+.2} r {:+.3} th r {:+.5} dth r {:+.5}",
            n as f64 / rate,
            sp,
            x.i_q,
            r.i_q,
            x.omega_m,
            r.omega_m,
            r.theta_m,
            r.theta_m - last
        );
        last = r.theta_m;
    });
}

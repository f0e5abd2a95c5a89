//! Angles that are logged at half the rate of the currents: what is lost between them is in the sigmas of a commissioned unit.

use std::fmt::Write;

use crate::folder::Folder;

/// The number of these bytes, little end first, that are `data[from..from + bytes]` of a frame.
fn number(data: &str, from: usize, bytes: usize) -> i64 {
    let text = data.get(2 * from..2 * (from + bytes)).unwrap_or_default();
    let big = u64::from_str_radix(text, 16).unwrap_or_default().swap_bytes() >> (64 - 8 * bytes);
    let unused = 64 - 8 * bytes as u32;
    ((big << unused) as i64) >> unused
}

/// The samples of a log as a table, with the angles of every `of`-th.
fn table(log: &str, of: usize) -> String {
    let mut rows = "t [s],I_A [mA],I_B [mA],I_C [mA],theta_m [counts],theta_o [counts],phi_set [rad],mode\n".to_owned();
    let (mut sample, mut currents, mut angles) = (0, String::new(), String::new());
    for line in log.lines() {
        let (before, data) = line.split_once('#').unwrap_or_default();
        let time = before.trim_start_matches('(').split(')').next().unwrap_or_default();
        match before.rsplit(' ').next() {
            Some("100") => {
                let [a, b, c] = [0, 2, 4].map(|from| number(data, from, 2));
                currents = format!("{time},{a},{b},{c}");
            }
            Some("101") if sample % of == 0 => angles = format!("{},{}", number(data, 0, 4), number(data, 4, 3)),
            Some("101") => angles = ",".to_owned(),
            Some("102") => {
                let set_point = number(data, 0, 4) as f64 * 1e-6;
                let written = writeln!(rows, "{currents},{angles},{set_point:.6},{}", number(data, 4, 1));
                sample += usize::from(written.is_ok());
            }
            _ => {}
        }
    }
    rows
}

const MAP: &str = "[map]\nresample = true\ntime = \"t\"\ncurrents.a = \"I_A\"\ncurrents.b = \"I_B\"\ncurrents.c = \"I_C\"\n\
                   position.motor = \"theta_m\"\nposition.output = \"theta_o\"\ncommand.position = \"phi_set\"\ncommand.mode = \"mode\"\n\
                   [type.own]\nbased_on = \"bench\"\n[type.own.drive]\nkind = \"vector\"\n[type.own.sensors]\nsample_rate_hz = 500\n\
                   [[actuator]]\nid = 0\ntype = \"own\"\n";

#[test]
fn a_short_by_interpolated_angles_is_within_its_sigma_and_no_other_phase_is_accused() {
    let folder = Folder::new();
    folder.write("map.toml", MAP);
    folder.write("unit.toml", format!("{MAP}calibration = \"unit.calibration\"\n"));
    let write = |options: &str, of: usize| {
        folder.done(&format!(
            "simulate --drive vector --rate 500 --noise 0.03 {options} -o unit.log"
        ));
        let log = String::from_utf8(folder.read("unit.log")).expect("a log of text");
        folder.write("unit.csv", table(&log, of));
    };
    write("--windows 8 --seed 3", 1);
    folder.done("calibrate unit.csv -c map.toml -o unit.calibration");
    write("--windows 4 --seed 9 --fault short_a=0.2", 2);
    let lines = folder.done("replay unit.csv -c unit.toml --json");
    for line in lines.lines() {
        let window: serde_json::Value = serde_json::from_str(line).expect("JSON");
        for (place, truth) in [(2, 0.2), (3, 0.0), (4, 0.0)] {
            let of = |list: &str| window[list][place].as_f64().expect("a short that the window shows");
            let off = (of("k") - truth) / of("sigma");
            assert!(off.abs() < 2.5, "{place}: {off:.1} sigmas: {line}");
        }
        assert!(!line.contains("\"short_b\"]"), "{line}");
    }
}

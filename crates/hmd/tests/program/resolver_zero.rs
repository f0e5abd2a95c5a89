//! A resolver whose zero is far off is named with its angle, beside what looks the same.

use crate::folder::Folder;

/// A log whose motor turns ahead by so many resolver counts.
fn ahead(log: &str, counts: i32) -> String {
    let lines = log.lines().map(|line| match line.split_once(" 101#") {
        Some((before, data)) => {
            let read = u32::from_str_radix(&data[..8], 16).unwrap_or_default().swap_bytes();
            let moved = read.wrapping_add_signed(counts).swap_bytes();
            format!("{before} 101#{moved:08X}{}\n", &data[8..])
        }
        None => format!("{line}\n"),
    });
    lines.collect()
}

#[test]
fn a_far_zero_of_the_resolver_is_named_with_its_angle_at_any_rate() {
    let folder = Folder::new();
    for rate in [400, 2000] {
        folder.done(&format!("simulate --rate {rate} --noise 0.03 --seed 9 -o right.log"));
        let right = String::from_utf8(folder.read("right.log")).expect("a log of text");
        for (degrees, said) in [
            (20, "resolver zero: +"),
            (45, "resolver zero: +45."),
            (90, "resolver zero: +90."),
            (
                120,
                "or phase order: all seem shifted by one place, or current sign: all seem reversed",
            ),
            (180, "current sign: all seem reversed: "),
            (222, "or current sign: all seem reversed, and the resolver +42."),
        ] {
            // Four pole pairs, 65536 counts.
            folder.write("far.log", ahead(&right, 65536 * degrees / 1440));
            let lines = folder.done("replay far.log --json");
            assert!(lines.contains(said), "{rate} {degrees}: {lines}");
            assert!(lines.contains("resolver zero"), "{rate} {degrees}: {lines}");
            assert!(!lines.contains("sample order"), "{rate} {degrees}: {lines}");
            // The zero is taken out.
            assert!(lines.contains("\"status\":\"degraded\""), "{rate} {degrees}: {lines}");
            assert!(lines.contains("\"faults\":[]"), "{rate} {degrees}: {lines}");
        }
    }
}

/// A log whose phase currents stand in cyclic order: a in the place of b, b of c, c of a.
fn cyclic(log: &str) -> String {
    let lines = log.lines().map(|line| match line.split_once(" 100#") {
        Some((before, data)) => format!("{before} 100#{}{}{}\n", &data[8..12], &data[..8], &data[12..]),
        None => format!("{line}\n"),
    });
    lines.collect()
}

#[test]
fn phases_in_cyclic_order_are_named_of_a_commissioned_unit_too() {
    let folder = Folder::new();
    let unit = "--drive vector --with cogging_nm=0.09 --with resolver_error_1_rad=3e-3 --noise 0.03";
    folder.done(&format!("simulate {unit} --windows 6 --seed 3 -o healthy.log"));
    folder.done("calibrate healthy.log -o unit.toml");
    folder.write("hmd.toml", "[[actuator]]\nid = 0\ncalibration = \"unit.toml\"\n");
    folder.done(&format!("simulate {unit} --seed 9 -o right.log"));
    let right = String::from_utf8(folder.read("right.log")).expect("a log of text");
    folder.write("cyclic.log", cyclic(&right));
    for config in ["", "-c hmd.toml"] {
        let lines = folder.done(&format!("replay cyclic.log {config} --json"));
        assert!(
            lines.contains("phase order: all seem shifted by one place"),
            "{config}: {lines}"
        );
        assert!(!lines.contains("all three phases alike"), "{config}: {lines}");
    }
}

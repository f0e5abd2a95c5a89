//! A unit whose gear bends by about as much as its play is wide: no spring explains its windows, and nothing else is accused for it.

use crate::folder::Folder;

const TYPE: &str = "[type.pm48]\nbased_on = \"servo28\"\n[type.pm48.motor]\npole_pairs = 5\nphase_resistance_ohm = 0.42\n\
phase_inductance_h = 0.9e-3\nback_emf_coefficient_v_s_per_rad = 0.075\ncurrent_max_a = 9.0\nbus_voltage_v = 48.0\ninertia_kg_m2 = 4.5e-5\n\
viscous_damping_nm_s_per_rad = 2e-5\n[type.pm48.transmission]\ngear_ratio = 90\nefficiency_opposing = 0.75\nefficiency_aiding = 0.66\n\
dynamic_friction_nm = 0.025\nstatic_friction_nm = 0.05\nbacklash_rad = 2e-4\n[type.pm48.controller]\nposition_gain_per_s = 2250\n\
speed_proportional_gain_nm_s_per_rad = 0.0135\nspeed_integral_gain_nm_per_rad = 0.22\nspeed_max_rad_s = 300\n[type.pm48.drive]\n\
kind = \"vector\"\npwm_frequency_hz = 20000\n[type.pm48.sensors]\nsample_rate_hz = 2000\nmotor_resolver_counts_per_rev = 16384\n\
output_encoder_counts_per_rev = 40000\ncurrent_full_scale_a = 20.0\n";

const UNIT: &str = "drive = \"vector\"\ndead_time_s = 0.8e-6\ncompliance_hz = 90\ncompliance_damping = 0.05\nload_inertia_share = 0.25\n\
load_friction_share = 0.3\nmesh_ripple = 0.07\ngear_teeth = 11\nresolver_error_1_rad = 3e-3\nplay_deviation = 0.3\n";

/// The same without its spring, of which a later window has another load.
const RIGID: &str =
    "drive = \"vector\"\ndead_time_s = 0.8e-6\nopposing_efficiency_deviation = -0.08\nplay_deviation = 0.3\n";

/// A folder with a type, and a unit of it with these effects commissioned from ten windows; what `calibrate` said.
fn commissioned(effects: &str) -> (Folder, String) {
    let folder = Folder::new();
    let actuator = "[[actuator]]\nid = 0\ntype = \"pm48\"\n";
    folder.write("new.toml", format!("{TYPE}{actuator}"));
    folder.write("known.toml", format!("{TYPE}{actuator}calibration = \"unit.toml\"\n"));
    folder.write("effects.toml", effects);
    simulate(&folder, "--windows 10 --seed 11 -o healthy.log");
    let ended = folder.hmd("calibrate healthy.log -c new.toml -o unit.toml");
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    (folder, ended.stderr)
}

fn simulate(folder: &Folder, line: &str) {
    folder.done(&format!(
        "simulate -c new.toml --actuator pm48 --effects effects.toml --noise 0.03 {line}"
    ));
}

fn replayed(folder: &Folder, line: &str) -> String {
    simulate(folder, &format!("{line} -o later.log"));
    folder.done("replay later.log -c known.toml --json")
}

#[test]
#[ignore = "long form: cargo xtask robust"]
fn a_gear_that_may_bend_is_said_and_accuses_neither_windings_nor_sensors() {
    let (folder, said) = commissioned(UNIT);
    assert!(said.contains("the gear may bend"), "{said}");
    for seed in [500, 501] {
        let lines = replayed(&folder, &format!("--windows 4 --seed {seed}"));
        assert_eq!(lines.matches("\"faults\":[]").count(), 4, "{seed}: {lines}");
        assert!(!lines.contains("load sensor"), "{seed}: {lines}");
    }
    let worn = replayed(&folder, "--windows 2 --seed 200 --fault backlash=0.2");
    assert_eq!(worn.matches("\"faults\":[\"backlash\"]").count(), 2, "{worn}");
    assert!(!worn.contains("gear ratio") && !worn.contains("encoder"), "{worn}");
}

#[test]
fn a_spring_load_since_commissioning_is_no_worn_friction() {
    let (folder, said) = commissioned(RIGID);
    assert!(!said.contains("may bend"), "{said}");
    let lines = replayed(&folder, "--windows 4 --seed 900 --with spring_nm_per_rad=30");
    assert_eq!(lines.matches("\"faults\":[]").count(), 4, "{lines}");
    let worn = replayed(&folder, "--windows 2 --seed 901 --fault friction=0.2");
    assert_eq!(worn.matches("\"faults\":[\"friction\"]").count(), 2, "{worn}");
}

/// A spring load that nobody measures, behind a gear too stiff to show that it bends: it holds the output at one flank where the first
/// window turns back, and leaves it to the motion where the second one does.
#[test]
#[ignore = "long form: cargo xtask robust"]
fn a_play_that_a_spring_load_closes_is_not_seen_and_no_healthy_one() {
    const SPRING: &str = "drive = \"vector\"\nspring_nm_per_rad = 300\nsetpoint_rate_rad_s = 2\nload_inertia_share = 0.2\ncompliance_hz = 300\n";
    let folder = Folder::new();
    let actuator = "[[actuator]]\nid = 0\ntype = \"bench\"\n[type.bench.drive]\nkind = \"vector\"\n";
    folder.write("new.toml", actuator);
    folder.write(
        "known.toml",
        actuator.replace("\n[type", "\ncalibration = \"unit.toml\"\n[type"),
    );
    folder.write("effects.toml", SPRING);
    let simulated = |line: &str| {
        folder.done(&format!(
            "simulate --actuator bench --effects effects.toml --noise 0.03 {line}"
        ));
    };
    simulated("--windows 10 --seed 11 -o healthy.log");
    folder.done("calibrate healthy.log -c new.toml -o unit.toml");
    for damage in [0.0, 0.1, 0.2] {
        simulated(&format!("--windows 2 --seed 5 --fault backlash={damage} -o later.log"));
        let lines = folder.done("replay later.log -c known.toml --json");
        let [first, second]: [&str; 2] = lines.lines().collect::<Vec<_>>().try_into().expect("two windows");
        assert!(
            first.contains("backlash (needs a reversal without a load"),
            "{damage}: {first}"
        );
        assert_eq!(
            second.contains("\"faults\":[\"backlash\"]"),
            damage > 0.0,
            "{damage}: {second}"
        );
    }
}

//! The configuration: defaults, overrides, and the words of every refusal.

use ema_models::{ActuatorParams, FaultId};
use ema_wire::ActuatorId;
use hmd_core::config::{Config, DEFAULT_BITRATE_BIT_S, HealthConfig, IdentificationConfig, LOAD_MAX, SearchMethod};
use hmd_core::window::WindowConfig;
use proptest::prelude::*;
use serde_json::Value;

const EXAMPLE: &str = include_str!("../../../../fixtures/hmd.toml");
const REFERENCE: &str = include_str!("../../../../docs/config.md");

fn read(text: &str) -> Config {
    Config::from_toml_str(text, "hmd.toml").unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn refusal(text: &str) -> String {
    match Config::from_toml_str(text, "hmd.toml") {
        Ok(_) => panic!("accepted:\n{text}"),
        Err(error) => error.to_string(),
    }
}

fn id(index: u8) -> ActuatorId {
    ActuatorId::new(index).expect("0 to 15")
}

/// The example with its commented keys in force.
fn example_in_full() -> String {
    let in_force = |line: &'static str| match line.strip_prefix('#') {
        Some(key) if !key.starts_with(' ') => key,
        _ => line,
    };
    EXAMPLE.lines().map(in_force).collect::<Vec<_>>().join("\n")
}

#[test]
fn empty_file_means_the_built_in_defaults() {
    let config = read("");
    assert_eq!(config, Config::from_toml_str("", "elsewhere.toml").unwrap());
    for (name, params) in [
        ("bench", ActuatorParams::bench()),
        ("servo28", ActuatorParams::servo28()),
        ("servo270", ActuatorParams::servo270()),
    ] {
        assert_eq!(config.actuator_type(name).unwrap().params, params);
    }
    assert_eq!(*config.window(), WindowConfig::default());
    assert_eq!(*config.identification(), IdentificationConfig::default());
    assert_eq!(*config.health(), HealthConfig::default());
    assert!(config.output().raw_frames);
    assert_eq!(Config::default().hash(), config.hash());
}

#[test]
fn example_equals_the_defaults() {
    assert_eq!(read(EXAMPLE), read(""));
    assert_eq!(read(EXAMPLE).hash(), read("").hash());
}

#[test]
fn example_shows_every_key_and_the_reference_explains_it() {
    let text = example_in_full();
    let config = read(&text);
    assert_eq!(config.actuators().len(), 2);
    assert_eq!(config.actuators()[0].params.sensors.sample_rate.round() as u32, 400);
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let Some((key, _)) = line.split_once(" = ") else {
            continue;
        };
        let documented = REFERENCE.contains(&format!("`{key}`")) || REFERENCE.contains(&format!("NAME.{key}]"));
        assert!(documented, "{key} is not in docs/config.md");
    }
    // What the reference lists is in the example, so that neither runs ahead of the other.
    for row in REFERENCE.lines().filter_map(|line| line.strip_prefix("| `")) {
        let key = row.split('`').next().unwrap();
        assert!(
            text.lines().any(|line| line.starts_with(&format!("{key} = "))),
            "{key} is not in fixtures/hmd.toml"
        );
    }
}

#[test]
fn every_parameter_can_be_overridden() {
    let json = read("").to_json();
    let bench = json["config"]["type"]["bench"].as_object().unwrap();
    let mut count = 0;
    // The drive has a kind, and numbers of one kind only.
    for (group, keys) in bench
        .iter()
        .filter(|(name, value)| value.is_object() && *name != "drive")
    {
        for (key, value) in keys.as_object().unwrap() {
            // Doubled or halved, whichever the limits and the other parameters allow.
            let half = matches!(
                key.as_str(),
                "efficiency_opposing" | "efficiency_aiding" | "dynamic_friction_nm" | "period_s" | "sample_rate_hz"
            );
            let value = value.as_f64().unwrap();
            let wanted = if half {
                value / 2.0
            } else {
                2.0 * value + f64::from(u8::from(value == 0.0))
            };
            let text = format!("[type.own]\nbased_on = \"bench\"\n{group}.{key} = {wanted}");
            let own = &read(&text).to_json()["config"]["type"]["own"];
            let mut expected = Value::Object(bench.clone());
            expected[group][key] = wanted.into();
            assert_eq!(own, &expected, "{key}");
            count += 1;
        }
    }
    assert_eq!(count, 32);
}

#[test]
fn built_in_type_can_be_redefined_and_a_new_one_must_say_from_what() {
    let config = read("[type.servo28.motor]\nphase_resistance_ohm = 0.7");
    let mut expected = ActuatorParams::servo28();
    expected.motor.r_s = 0.7;
    assert_eq!(config.actuator_type("servo28").unwrap().params, expected);
    let config = read("[type.bench.sensors]\nsample_rate_hz = 400");
    assert_eq!(
        config
            .actuator_for("can0", id(3))
            .unwrap()
            .params
            .sensors
            .sample_rate
            .round() as u32,
        400
    );
    assert_eq!(
        refusal("[type.flap]"),
        "hmd.toml:1: type.flap.based_on: expected \"bench\", \"servo28\" or \"servo270\", found no such key"
    );
}

#[test]
fn actuators_are_found_by_bus_and_number() {
    let auto = read("");
    assert!(auto.is_auto());
    let found = auto.actuator_for("can7", id(15)).unwrap();
    assert_eq!((found.name.as_str(), found.type_name.as_str()), ("ema15", "bench"));
    let config = read(
        "[[actuator]]\nid = 0\nbus = \"can0\"\ntype = \"servo28\"\n\
         [[actuator]]\nid = 0\nbus = \"can1\"\nname = \"b\"\n[[actuator]]\nid = 1\n\
         [type.bench.sensors]\nsample_rate_hz = 400",
    );
    let name = |bus, n| config.actuator_for(bus, id(n)).map(|actuator| actuator.name.as_str());
    assert_eq!(
        [name("can0", 0), name("can1", 0), name("can2", 0)],
        [Some("ema0"), Some("b"), None]
    );
    assert_eq!(
        [name("can0", 1), name("can9", 1), name("can0", 2)],
        [Some("ema1"), Some("ema1"), None]
    );
    assert_eq!(config.actuator_named("ema0").unwrap().params, ActuatorParams::servo28());
}

#[test]
fn fault_levels_override_the_common_ones() {
    let config = read("[health]\nwarning = 0.4\n[health.fault.gain]\nwatch = 0.1\npersistence = 3");
    let gain = config.health().levels_of("gain").unwrap();
    assert_eq!((gain.watch, gain.warning, gain.persistence), (0.1, 0.4, 3));
    for name in FaultId::NAMES.iter().filter(|name| **name != "gain") {
        let levels = config.health().levels_of(name).unwrap();
        assert_eq!((levels.watch, levels.warning, levels.persistence), (0.05, 0.4, 1));
    }
    assert!(config.health().levels_of("eccentricity_phase").is_none());
}

#[test]
fn method_brings_its_own_defaults() {
    let config = read("[identification]\nmethod = \"ga\"\ngenerations = 100");
    let expected = IdentificationConfig {
        generations: 100,
        ..IdentificationConfig::for_method(SearchMethod::Ga)
    };
    assert_eq!(*config.identification(), expected);
    assert_eq!(expected.population, 200);
}

#[test]
fn bus_load_counts_the_actuators_of_each_interface() {
    let config = read(&six_at_400_hz("can0"));
    let loads = config.bus_loads();
    assert_eq!(
        (loads.len(), loads[0].bus.as_deref(), loads[0].actuators),
        (1, Some("can0"), 6)
    );
    assert!((0.8..LOAD_MAX).contains(&loads[0].load), "{}", loads[0].load);
    assert!(
        config.describe().contains("bus load: can0 87 % of 1000000 bit/s"),
        "{}",
        config.describe()
    );
    let seventh = "[[actuator]]\nid = 6\nbus = \"can0\"\ntype = \"slow\"\n";
    assert_eq!(
        refusal(&format!("{}{seventh}", six_at_400_hz("can0"))),
        "hmd.toml: bus can0: expected a load of at most 90 %, found 102 % of 1000000 bit/s by 7 actuators; lower \
         sensors.sample_rate_hz of their type, or set actuator.bus to spread them over several interfaces"
    );
    read(&format!("{}{}", six_at_400_hz("can0"), seventh.replace("can0", "can1")));
    read(&format!("{}{seventh}[bus]\nfd = true", six_at_400_hz("can0")));
    assert!(refusal("[[actuator]]\nid = 0\n[[actuator]]\nid = 1").contains("bus (any): expected a load of at most"));
}

#[test]
fn a_serial_line_is_a_bus_with_a_device() {
    let on_uart = "[[actuator]]\nid = 0\nbus = \"uart1\"\n[[serial]]\nbus = \"uart1\"\ndevice = \"ttyACM0\"\n";
    let config = read(on_uart);
    let line = config.serial("uart1").unwrap();
    assert_eq!(
        (line.bitrate_bit_s, line.device.to_str()),
        (DEFAULT_BITRATE_BIT_S, Some("ttyACM0"))
    );
    assert_eq!(config.serial("can0"), None);
    let text = config.describe();
    assert!(
        text.contains("serial line: uart1 at ttyACM0\nbus load: uart1 85 % of 921600 bit/s"),
        "{text}"
    );

    let second = on_uart.replace("[[serial]]", "[[actuator]]\nid = 1\nbus = \"uart1\"\n[[serial]]");
    assert!(refusal(&second).contains("bus uart1: expected a load of at most 90 %, found 170 % of 921600 bit/s"));
    read(&format!("{second}bitrate_bit_s = 2_000_000"));

    let line = "[[serial]]\nbus = \"uart1\"\n";
    for (text, expected) in [
        (
            format!("{on_uart}{line}device = \"b\""),
            "serial[1].bus: expected a name that no other serial line has",
        ),
        (
            format!(
                "{on_uart}[[actuator]]\nid = 1\nbus = \"uart2\"\n[[serial]]\nbus = \"uart2\"\ndevice = \"ttyACM0\""
            ),
            "serial[1].device: expected a device that no other serial line has, found \"ttyACM0\"",
        ),
        (
            format!("{line}device = \"b\""),
            "hmd.toml:2: serial[0].bus: expected the bus of an [[actuator]]",
        ),
        (
            line.to_owned(),
            "serial[0].device: expected the path of a terminal, found no such key",
        ),
        (
            line.replace("uart1", "a/b"),
            "serial[0].bus: expected a name of 1 to 15 printable characters",
        ),
        (
            format!("{on_uart}bitrate_bit_s = 0"),
            "serial[0].bitrate_bit_s: expected a whole number from 1200",
        ),
    ] {
        let text = refusal(&text);
        assert!(text.contains(expected), "{text}");
    }
}

fn six_at_400_hz(bus: &str) -> String {
    let slow = "type.slow = { based_on = \"bench\", sensors = { sample_rate_hz = 400 } }\n".to_owned();
    (0..6).fold(slow, |text, n| {
        text + &format!("[[actuator]]\nid = {n}\nbus = \"{bus}\"\ntype = \"slow\"\n")
    })
}

#[test]
fn refusals_say_where_what_and_why() {
    for (text, words) in [
        (
            "[window]\n\nduration_m = 1",
            "hmd.toml:3: window.duration_m: unknown key; did you mean duration_ms?",
        ),
        ("[widow]", "hmd.toml:1: widow: unknown key; did you mean window?"),
        (
            "[output]\ncolour = 1",
            "hmd.toml:2: output.colour: unknown key; known here: raw_frames",
        ),
        (
            "[[actuator]]\nidd = 0",
            "hmd.toml:2: actuator[0].idd: unknown key; did you mean id?",
        ),
        (
            "[health.fault.eccentricity_phase]",
            "health.fault.eccentricity_phase: unknown key",
        ),
        (
            "[window]\nrest_ms = \"20\"",
            "hmd.toml:2: window.rest_ms: expected a number from 1 to 1000, found \"20\"",
        ),
        (
            "[window]\nrest_ms = nan",
            "window.rest_ms: expected a number from 1 to 1000, found nan",
        ),
        (
            "[window]\nduration_ms = inf",
            "window.duration_ms: expected a number from 20 to 10000, found inf",
        ),
        (
            "[window]\nduration_ms = 1e999",
            "window.duration_ms: expected a number from 20 to 10000, found 1e999",
        ),
        (
            "[window]\nduration_ms = 20",
            "window.pre_trigger_ms: expected less than duration_ms = 20, found 20 (not set here)",
        ),
        (
            "[window]\npre_trigger_ms = 30",
            "hmd.toml:2: window.pre_trigger_ms: expected at most rest_ms = 20, found 30",
        ),
        (
            "[window]\npre_trigger_ms = 0.3",
            "hmd.toml:2: window.pre_trigger_ms: expected from 0.5 to 20 at 2000 samples/s, found 0.3",
        ),
        (
            "[window]\nduration_ms = 21\nlongest_gap_ms = 22",
            "hmd.toml:3: window.longest_gap_ms: expected from 0 to 21 at 2000 samples/s, found 22",
        ),
        (
            "[[actuator]]\nid = 0\ncalibrated = \"a.toml\"",
            "hmd.toml:3: actuator[0].calibrated: unknown key; did you mean calibration?",
        ),
        (
            "[window]\nduration_ms = 99999999999999999999",
            "found 99999999999999999999",
        ),
        ("window = 3", "hmd.toml:1: window: expected a table, found 3"),
        ("[[window]]", "hmd.toml:1: window: expected a table, found an array"),
        (
            "[actuator]\nid = 0",
            "hmd.toml:1: actuator: expected an array of tables ([[…]]), found a table",
        ),
        (
            "[output]\nraw_frames = 1",
            "output.raw_frames: expected true or false, found 1",
        ),
        (
            "[identification]\nmethod = \"GA\"",
            "or \"ga\" or \"de\" or \"cmaes\" or \"least-squares\" or \"relations\", found \"GA\"",
        ),
        (
            "[identification]\nmethod = \"relations\"\ngenerations = 3",
            "identification.generations: expected none with method = \"relations\", found 3",
        ),
        (
            "[identification]\npopulation = 1e3",
            "population: expected a whole number from 4 to 100000, found 1e3",
        ),
        (
            "[identification]\nevaluations_max = 10",
            "evaluations_max: expected at least population = 32, found 10",
        ),
        (
            "[health]\nwarning = 0.7",
            "hmd.toml:1: health.critical: expected more than warning = 0.7, found 0.6 (not set here)",
        ),
        (
            "[health]\nwatch = 0.3",
            "health.warning: expected more than watch = 0.3, found 0.3 (not set here)",
        ),
        (
            "[health]\nend_of_life = 1.1",
            "health.end_of_life: expected a number from 0.001 to 1, found 1.1",
        ),
        (
            "[health]\nhysteresis = 0.05",
            "health.hysteresis: expected less than watch = 0.05, found 0.05",
        ),
        (
            "[health]\n[health.fault.gain]\nwatch = 0.4",
            "hmd.toml:2: health.fault.gain.warning: expected more than watch = 0.4",
        ),
        (
            "[[actuator]]\nname = \"a\"",
            "hmd.toml:1: actuator[0].id: expected a whole number from 0 to 15, found no such key",
        ),
        (
            "[[actuator]]\nid = 16",
            "hmd.toml:2: actuator[0].id: expected a whole number from 0 to 15, found 16",
        ),
        (
            "[[actuator]]\nid = 256",
            "actuator[0].id: expected a whole number from 0 to 15, found 256",
        ),
        (
            "[[actuator]]\nid = 1\nname = \"a/b\"",
            "actuator[0].name: expected a name of 1 to 64 letters",
        ),
        (
            "[[actuator]]\nid = 1\nname = \"hmd\"",
            "none of bus, hmd, log, found \"hmd\"",
        ),
        (
            "[[actuator]]\nid = 1\ntype = \"x\"",
            "actuator[0].type: expected a type: bench, servo270, servo28, found \"x\"",
        ),
        (
            "[[actuator]]\nid = 1\nbus = \"can0\"\n[[actuator]]\nid = 1\nname = \"b\"",
            "hmd.toml:5: actuator[1].id: expected a number that ema1 on can0 does not have, found 1",
        ),
        (
            "[[actuator]]\nid = 1\nname = \"ema0\"\n[[actuator]]\nid = 0",
            "hmd.toml:4: actuator[1].name: expected a name that no other actuator has, found \"ema0\" (by default)",
        ),
        (
            "[type.bench.motor]\nphase_resistance_ohm = nan",
            "hmd.toml:2: type.bench.motor.phase_resistance_ohm: expected a number from 0.0001 to 10000, found nan",
        ),
        (
            "[type.bench.motor]\npole_pairs = 3.5",
            "type.bench.motor.pole_pairs: expected a whole multiple of 1, found 3.5",
        ),
        (
            "[type.bench.motor]\nr_s = 1",
            "type.bench.motor.r_s: unknown key; known here: pole_pairs, phase_resistance_ohm",
        ),
        (
            "[type.bench.transmission]\ndynamic_friction_nm = 0.5",
            "type.bench.transmission.static_friction_nm: expected at least dynamic_friction_nm = 0.5, found 0.3 (not set here)",
        ),
        (
            "[type.bench.sensors]\nsample_rate_hz = 3000",
            "hmd.toml:2: type.bench.sensors.sample_rate_hz: expected a rate whose sample period is a whole multiple of \
             controller.period_s = 0.0001, found 3000",
        ),
        (
            "[type.bench.sensors]\ncurrent_resolution_bits = -1",
            "current_resolution_bits: expected a number from 4 to 24, found -1",
        ),
        (
            "[type.bench.sensors]\ncurrent_resolution_bits = 12.5",
            "current_resolution_bits: expected a whole number, found 12.5",
        ),
        ("[type.\"a b\"]", "type.\"a b\": expected a name of 1 to 64 letters"),
        (
            "[bus]\nbitrate_bit_s = 0",
            "bus.bitrate_bit_s: expected a whole number from 10000 to 1000000, found 0",
        ),
        (
            "[bus]\ndata_bitrate_bit_s = 500_000",
            "expected at least bitrate_bit_s = 1000000, found 500_000",
        ),
        ("[bus]\nfd = true\nfd = true", "hmd.toml:3: not valid TOML: "),
        ("a\n= [", "hmd.toml:1: not valid TOML: "),
    ] {
        let message = refusal(text);
        assert!(message.contains(words), "{text}\n  found  {message}\n  wanted {words}");
        assert!(!message.contains('\n'), "one line: {message}");
    }
}

#[test]
fn files_are_read_and_their_paths_resolved() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("hmd.toml");
    let missing = hmd_storage::config_file::load_config(&path).unwrap_err().to_string();
    assert!(
        missing.starts_with(&format!("{}: cannot be read: ", path.display())),
        "{missing}"
    );
    std::fs::write(&path, example_in_full()).unwrap();
    let config = hmd_storage::config_file::load_config(&path).unwrap();
    let calibration = std::path::Path::new("bench.calibration.toml");
    assert_eq!(config.resolve(calibration), directory.path().join(calibration));
    assert_eq!(
        config.hash(),
        read(&example_in_full()).hash(),
        "the place of a file is not part of its meaning"
    );
    std::fs::write(&path, [0xff, 0xfe, b'\n']).unwrap();
    assert!(
        hmd_storage::config_file::load_config(&path)
            .unwrap_err()
            .to_string()
            .contains("cannot be read")
    );
}

#[test]
fn hash_follows_the_meaning() {
    let base = read("[window]\nduration_ms = 400").hash();
    assert_eq!(base.len(), 64);
    assert_eq!(base, read("# a comment\nwindow.duration_ms = 4e2").hash());
    assert_ne!(base, read("[window]\nduration_ms = 401").hash());
    assert_ne!(base, read("").hash());
}

#[test]
fn description_names_what_is_configured() {
    let auto = read("").describe();
    assert!(
        auto.contains("every one seen on a bus, as ema<n> of type bench"),
        "{auto}"
    );
    assert!(
        auto.contains("bus load: 72 % of 1000000 bit/s by each at 2000 Hz, so 1 fit on one bus"),
        "{auto}"
    );
    assert!(
        auto.contains("hmd run refuses this configuration: expected an [[actuator]] with its bus"),
        "{auto}"
    );
    let text = read(&example_in_full()).describe();
    assert!(text.contains("hmd run: listens to can0"), "{text}");
    assert!(
        text.contains(
            "flap-left: number 0 on can0, type bench400 with hysteresis drive at 400 Hz, unit learnt from 10 windows, kept in \
             units, part 1FK7060, serial 0042"
        ),
        "{text}"
    );
    let one = read("[health.fault.friction]\nwatch = 0.1").describe();
    assert!(
        one.contains("health, every fault: watch 0.05") && one.contains("health, except friction: watch 0.1"),
        "{one}"
    );
}

proptest! {
    #[test]
    fn arbitrary_text_never_panics(text in "\\PC*", line in any::<prop::sample::Index>(), junk in "[\\[\\]{}=.\"'#\n0-9a-z_-]{0,12}") {
        let _ = Config::from_toml_str(&text, &text);
        // The example with one place broken reaches further than noise does.
        let mut lines: Vec<_> = EXAMPLE.lines().collect();
        let at = line.index(lines.len());
        lines[at] = &junk;
        let _ = Config::from_toml_str(&lines.join("\n"), "hmd.toml").map(|config| config.describe());
        // A value replaced, key kept.
        let replaced = EXAMPLE.lines().enumerate().map(|(i, line)| match line.split_once(" = ") {
            Some((key, _)) if i == at => format!("{key} = {junk}\n"),
            _ => format!("{line}\n"),
        });
        let _ = Config::from_toml_str(&replaced.collect::<String>(), "hmd.toml").map_err(|error| error.to_string());
    }

    #[test]
    fn arbitrary_numbers_are_checked(value in any::<f64>(), key in prop::sample::select(vec![
        "window.duration_ms", "health.watch", "type.bench.motor.inertia_kg_m2", "type.bench.controller.period_s",
        "type.bench.sensors.current_resolution_bits", "type.servo28.sensors.sample_rate_hz",
    ])) {
        let text = format!("{key} = {value:?}").replace("NaN", "nan");
        if let Ok(config) = Config::from_toml_str(&text, "hmd.toml") {
            prop_assert!(value.is_finite());
            prop_assert_eq!(config.hash(), Config::from_toml_str(&text, "hmd.toml").unwrap().hash());
        }
    }
}

/// Requirement S-13 of `docs/safety.md`.
/// Whoever reads a FIFO waits for its other end; nobody asked for that one.
#[test]
fn fifo_drop_in_is_refused_without_blocking() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("hmd.toml");
    std::fs::write(&file, "").unwrap();
    std::fs::create_dir(folder.path().join("conf.d")).unwrap();
    let dropin = folder.path().join("conf.d/1.toml");
    nix::unistd::mkfifo(&dropin, nix::sys::stat::Mode::S_IRWXU).unwrap();
    let error = hmd_storage::config_file::load_config(&file).unwrap_err().to_string();
    assert!(
        error.contains("1.toml") && error.contains("expected a regular file"),
        "{error}"
    );
}

#[test]
fn drop_ins_add_to_the_file_and_errors_name_theirs() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("conf.d")).unwrap();
    let write = |name: &str, text: &str| std::fs::write(at(name), text).unwrap();
    write(
        "hmd.toml",
        "[[actuator]]\nid = 0\nbus = \"can0\"\n[health]\nwatch = 0.04\nwarning = 0.2\n[type.x]\nbased_on = \"bench\"\n",
    );
    write(
        "conf.d/10-more.toml",
        "[[actuator]]\nid = 1\n[health]\nwarning = 0.25\n",
    );
    write(
        "conf.d/20-last.toml",
        "health.warning = 0.27\n[type.x.motor]\npole_pairs = 3\n",
    );
    write("conf.d/notes.txt", "not TOML");
    let load = || hmd_storage::config_file::load_config(at("hmd.toml"));
    let config = load().unwrap();
    assert_eq!(config.actuators().len(), 2);
    let levels = config.health().levels()[0];
    let motor = config.actuator_type("x").unwrap().params.motor;
    let found = format!("{} {} {}", levels.watch, levels.warning, motor.pole_pairs);
    assert_eq!(found, "0.04 0.27 3");

    let refused = |text: &str| {
        write("conf.d/20-last.toml", text);
        let error = load().unwrap_err().to_string();
        error.replace(&format!("{}/", folder.path().display()), "")
    };
    assert_eq!(
        refused("# a line\n[health]\nwarning = 7\n"),
        "conf.d/20-last.toml:3: health.warning: expected a number from 0.001 to 1, found 7"
    );
    assert!(refused("\nhelth = 1\n").starts_with("conf.d/20-last.toml:2: helth: unknown key; did you mean health?"));
    assert!(refused("[[actuator]]\nid = 1\n").starts_with("conf.d/20-last.toml:2: actuator[2].id: expected a number"));
    assert!(
        refused("\n\n= 1").starts_with("conf.d/20-last.toml:3: not valid TOML"),
        "{}",
        refused("\n\n= 1")
    );
    // A table against a value.
    assert!(refused("health = 3\n").starts_with("conf.d/20-last.toml:1: health: expected a table"));
}

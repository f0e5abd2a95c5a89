//! The newest state of an actuator as one line for a downlink.

use ema_models::FaultId;
use hmd_core::health::{HealthState, Levels, significance};
use hmd_core::newest::Newest;
use hmd_core::record::WindowStatus;
use hmd_core::timestamp::compact_minute;

/// Longest line, characters: the text of one ACARS block.
pub(super) const LENGTH_MAX: usize = 220;

/// Longest name of an actuator; of a longer one the middle is cut out.
const NAME_MAX: usize = 16;

/// Largest number of hours; more is printed as this.
const HOURS_MAX: f64 = 99_999.0;

/// Names of the faults that fit, in the order of [`FaultId::ALL`].
const SHORT_NAMES: [&str; FaultId::COUNT] = ["FRIC", "BKLSH", "SHORT-A", "SHORT-B", "SHORT-C", "ECC", "GAIN"];

/// Actuator, window, time, health, faults with damage in percent, hours left, probability of failing within the horizon, and
/// what ends the life; `serial_number`, where units of one name need it; what is suspected. By `levels` a damage is told that more windows must show. Capital letters, digits, space, hyphen, comma, stop and slash only, which every air-ground link carries.
pub(super) fn summary_line(newest: &Newest, levels: &[Levels; FaultId::COUNT], serial_number: Option<&str>) -> String {
    let Newest { health, rul, shown, .. } = newest;
    let mut fields = vec![
        "HMD1".to_owned(),
        sent_name(&health.actuator),
        format!("W{}", health.window),
        compact_minute(health.t_start_ns),
        health.health.clone(),
    ];
    if health.status != "ok" {
        fields.push(health.status.clone());
    }
    let states = newest.states();
    // A state by the remaining life is about the part that ends first.
    let ends_first = newest.state_by_life().and_then(|_| newest.ends_first());
    let is_fault = |fault: &FaultId| states[fault.index()] >= HealthState::Watch || ends_first == Some(*fault);
    let named = |fault: FaultId| {
        let name = SHORT_NAMES[fault.index()];
        shown.of(fault).map_or_else(
            || name.to_owned(),
            |shown| format!("{name} {:.0}", (100.0 * shown.damage).clamp(0.0, 100.0)),
        )
    };
    // The newest window shows it surely, and more windows must.
    let is_pending = |fault: &FaultId| {
        let shown = shown.of(*fault).filter(|shown| shown.t_start_ns == health.t_start_ns);
        let (state, level) = (states[fault.index()], levels[fault.index()].watch);
        let is_sure = shown.is_some_and(|shown| {
            shown.damage >= level && shown.damage >= significance(*fault) * shown.sigma.unwrap_or(f64::INFINITY)
        });
        is_sure && state == HealthState::Nominal && !is_fault(fault)
    };
    let faults: Vec<String> = FaultId::ALL.into_iter().filter(is_fault).map(named).collect();
    let pending: Vec<String> = FaultId::ALL.into_iter().filter(is_pending).map(named).collect();
    // A window that was not assessed says nothing.
    let is_assessed = ![WindowStatus::Invalid, WindowStatus::Unmodelled]
        .iter()
        .any(|not| not.name() == health.status);
    let is_nominal = is_assessed && health.health == HealthState::Nominal.name();
    let is_unknown = |n: &usize| states[*n] == HealthState::Unknown;
    let unknown: Vec<&str> = (0..FaultId::COUNT).filter(is_unknown).map(|n| SHORT_NAMES[n]).collect();
    if !faults.is_empty() {
        fields.push(faults.join(" "));
    } else if pending.is_empty() && unknown.is_empty() && is_nominal {
        fields.push("NO FAULT".to_owned());
    }
    match unknown.len() {
        0 => {}
        FaultId::COUNT => fields.push("ALL UNKNOWN".to_owned()),
        _ => fields.push(format!("UNKNOWN {}", unknown.join(" "))),
    }
    if !pending.is_empty() {
        fields.push(format!("PENDING {}", pending.join(" ")));
    }
    match (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) {
        (Some(p10), Some(p50), Some(p90)) => {
            let [p10, p50, p90] = [p10, p50, p90].map(|hours| hours.clamp(0.0, HOURS_MAX));
            fields.push(format!("RUL {p10:.0}-{p50:.0}-{p90:.0} H"));
            if rul.t_start_ns != 0 && rul.t_start_ns != health.t_start_ns {
                // The forecast of an earlier recording.
                fields.push(format!("AS OF {}", compact_minute(rul.t_start_ns)));
            } else if let (Some(probability), Some(horizon)) = (rul.failure_probability, rul.horizon_h) {
                fields.push(format!("PF {probability:.2} IN {:.0} H", horizon.clamp(0.0, HOURS_MAX)));
            }
            fields.push(format!("BY {}", rul.governed_by));
        }
        _ => fields.push("NO RUL".to_owned()),
    }
    fields.extend(serial_number.map(|number| format!("SN {}", number.chars().take(NAME_MAX).collect::<String>())));
    // Last, as the end of a name may be cut.
    let fallen = newest.fallen.contains(&true).then_some("fallen damage");
    let checks: Vec<&str> = health.suspects.iter().map(String::as_str).chain(fallen).collect();
    match checks.as_slice() {
        [] => {}
        [check] => fields.push(format!("CHECK {check}")),
        many => fields.push(format!("CHECK {} ITEMS", many.len())),
    }
    fields.join("/").chars().map(sent).take(LENGTH_MAX).collect()
}

/// The name of an actuator as it is sent: of one that is too long beginning and end, which tell left from right.
pub(super) fn sent_name(actuator: &str) -> String {
    let name: Vec<char> = actuator.chars().map(sent).collect();
    if name.len() <= NAME_MAX {
        return name.into_iter().collect();
    }
    let (first, last) = (&name[..NAME_MAX / 2 - 1], &name[name.len() - NAME_MAX / 2..]);
    first.iter().chain(['-'].iter()).chain(last).collect()
}

/// A character that the link carries.
fn sent(c: char) -> char {
    match c.to_ascii_uppercase() {
        c if c.is_ascii_uppercase() || c.is_ascii_digit() || " -,./".contains(c) => c,
        _ => '-',
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_core::record::{Health, Rul};

    const LEVELS: [Levels; FaultId::COUNT] = [Levels {
        watch: 0.05,
        warning: 0.3,
        critical: 0.6,
        end_of_life: 0.8,
        hysteresis: 0.02,
        persistence: 3,
    }; FaultId::COUNT];

    fn line_of(health: &Health, rul: &Rul, serial_number: Option<&str>) -> String {
        let mut newest = Newest::default();
        newest.add(health.clone());
        newest.add_rul(rul.clone());
        summary_line(&newest, &LEVELS, serial_number)
    }

    fn full() -> (Health, Rul) {
        let mut health = Health {
            actuator: "left_inner_élevon_of_the_test_rig".to_owned(),
            window: u64::from(u32::MAX),
            t_start_ns: 1_700_000_000_000_000_000,
            status: "degraded".to_owned(),
            health: "critical".to_owned(),
            suspects: vec!["winding temperature".to_owned()],
            ..Health::default()
        };
        health.set_states(&[HealthState::Critical; FaultId::COUNT]);
        health.set_damage([Some(1.0); FaultId::COUNT]);
        let rul = Rul {
            rul_p10_h: Some(1e9),
            rul_p50_h: Some(1e9),
            rul_p90_h: Some(1e9),
            failure_probability: Some(0.998),
            horizon_h: Some(1e9),
            governed_by: "response_time".to_owned(),
            ..Rul::default()
        };
        (health, rul)
    }

    #[test]
    fn the_longest_line_fits_whole_and_has_only_what_links_carry() {
        let (health, rul) = full();
        let line = line_of(&health, &rul, None);
        assert!(line.contains("/BY RESPONSE-TIME/CHECK WINDING"), "{line}");
        assert!(line.len() <= LENGTH_MAX, "{} characters: {line}", line.len());
        assert!(line.chars().all(|c| sent(c) == c), "{line}");
        // The longest mixture: one fault is unknown.
        let (mut health, rul) = full();
        let mut states = [HealthState::Critical; FaultId::COUNT];
        states[0] = HealthState::Unknown;
        health.set_states(&states);
        let line = line_of(&health, &rul, None);
        assert!(line.contains("/BY RESPONSE-TIME/CHECK"), "{line}");
    }

    #[test]
    fn a_line_shows_what_is_known() {
        let (mut health, mut rul) = full();
        health.actuator = "ema0".to_owned();
        health.window = 7;
        health.status = "ok".to_owned();
        health.suspects.clear();
        let mut states = [HealthState::Nominal; FaultId::COUNT];
        states[0] = HealthState::Critical;
        health.set_states(&states);
        (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) = (Some(140.0), Some(165.2), Some(191.0));
        rul.horizon_h = Some(100.0);
        rul.governed_by = "damage".to_owned();
        health.set_damage([Some(0.748), None, None, None, None, None, None]);
        assert_eq!(
            line_of(&health, &rul, None),
            "HMD1/EMA0/W7/20231114T2213Z/CRITICAL/FRIC 75/RUL 140-165-191 H/PF 1.00 IN 100 H/BY DAMAGE"
        );
        let of_unit = line_of(&health, &rul, Some("2031a"));
        assert!(of_unit.ends_with("/BY DAMAGE/SN 2031A"), "{of_unit}");
        states[0] = HealthState::Nominal;
        health.set_states(&states);
        health.health = "nominal".to_owned();
        assert_eq!(
            line_of(&health, &Rul::default(), None),
            "HMD1/EMA0/W7/20231114T2213Z/NOMINAL/NO FAULT/NO RUL"
        );
        states[1] = HealthState::Unknown;
        health.set_states(&states);
        health.health = "unknown".to_owned();
        let expected = "HMD1/EMA0/W7/20231114T2213Z/UNKNOWN/UNKNOWN BKLSH/NO RUL";
        assert_eq!(line_of(&health, &Rul::default(), None), expected);
        health.set_states(&[HealthState::Unknown; FaultId::COUNT]);
        let expected = "HMD1/EMA0/W7/20231114T2213Z/UNKNOWN/ALL UNKNOWN/NO RUL";
        assert_eq!(line_of(&health, &Rul::default(), None), expected);
    }

    #[test]
    fn what_is_no_fault_yet_and_what_is_suspected_is_told() {
        let mut health = Health {
            actuator: "ema0".to_owned(),
            status: "ok".to_owned(),
            health: "nominal".to_owned(),
            ..Health::default()
        };
        health.set_states(&[HealthState::Nominal; FaultId::COUNT]);
        let line = |health: &Health| line_of(health, &Rul::default(), None);
        let shows = |health: &mut Health, friction: f64, sigma: f64| {
            health.k1_sigma = Some(sigma);
            health.set_damage([Some(friction), None, None, None, None, None, None]);
        };
        shows(&mut health, 0.41, 0.05);
        assert_eq!(
            line(&health),
            "HMD1/EMA0/W0/19700101T0000Z/NOMINAL/PENDING FRIC 41/NO RUL"
        );
        // Too uncertain, and too little.
        for (friction, sigma) in [(0.41, 0.2), (0.04, 0.001)] {
            shows(&mut health, friction, sigma);
            assert_eq!(line(&health), "HMD1/EMA0/W0/19700101T0000Z/NOMINAL/NO FAULT/NO RUL");
        }
        health.suspects = vec!["load sensor".to_owned()];
        let one = "HMD1/EMA0/W0/19700101T0000Z/NOMINAL/NO FAULT/NO RUL/CHECK LOAD SENSOR";
        assert_eq!(line(&health), one);
        health.suspects.push("dc link".to_owned());
        assert!(line(&health).ends_with("/CHECK 2 ITEMS"), "{}", line(&health));
    }

    #[test]
    fn long_names_keep_what_tells_them_apart() {
        let names = ["aileron-outboard-left", "aileron-outboard-right", "flap-left-inboard"];
        let sent = ["AILERON-ARD-LEFT", "AILERON-RD-RIGHT", "FLAP-LE--INBOARD"];
        assert_eq!(names.map(sent_name), sent);
        assert_eq!(sent_name("aileron-out-left"), "AILERON-OUT-LEFT");
    }

    #[test]
    fn the_forecast_of_an_earlier_window_has_its_time() {
        let (mut health, mut rul) = full();
        health.t_start_ns = 1_700_000_060_000_000_000;
        rul.t_start_ns = 1_700_000_000_000_000_000;
        let line = line_of(&health, &rul, None);
        assert!(line.contains("H/AS OF 20231114T2213Z/BY RESPONSE-TIME/CHECK"), "{line}");
        assert!(line.len() <= LENGTH_MAX, "{} characters: {line}", line.len());
        rul.t_start_ns = health.t_start_ns;
        assert!(!line_of(&health, &rul, None).contains("AS OF"));
    }

    #[test]
    fn a_line_that_alarms_names_a_fault() {
        // Not assessed: the list of its window is empty, the states go on.
        let mut states = [HealthState::Nominal; FaultId::COUNT];
        states[1] = HealthState::Watch;
        let mut health = Health {
            actuator: "ema0".to_owned(),
            status: "invalid".to_owned(),
            health: "watch".to_owned(),
            ..Health::default()
        };
        health.set_states(&states);
        let line = line_of(&health, &Rul::default(), None);
        assert_eq!(line, "HMD1/EMA0/W0/19700101T0000Z/WATCH/INVALID/BKLSH/NO RUL");
        // Worse by the remaining life: the part that ends first.
        health.health = "critical".to_owned();
        health.set_damage([Some(0.04), None, None, None, None, None, None]);
        let mut newest = Newest::default();
        newest.add(health.clone());
        for (fault, p10) in [("friction", Some(9.0)), ("backlash", None)] {
            newest.add_rul(Rul {
                dominant_fault: fault.to_owned(),
                rul_p10_h: p10,
                ..Rul::default()
            });
        }
        let line = summary_line(&newest, &LEVELS, None);
        assert_eq!(line, "HMD1/EMA0/W0/19700101T0000Z/CRITICAL/INVALID/FRIC 4 BKLSH/NO RUL");
        health.set_states(&[HealthState::Nominal; FaultId::COUNT]);
        let line = line_of(&health, &Rul::default(), None);
        assert_eq!(line, "HMD1/EMA0/W0/19700101T0000Z/CRITICAL/INVALID/NO RUL");
    }
}

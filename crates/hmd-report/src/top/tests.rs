use std::io::Cursor as Bytes;

use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::style::{Color, Modifier};

use super::*;
use hmd_core::record::{ActuatorStatus, Estimate, Health, InterfaceStatus, Log, LogLevel, Rul, Status, Window};
use hmd_storage::mcap::McapMessages;
use hmd_storage::mcap_writer::McapWriter;

const SECOND: u64 = 1_000_000_000;
/// 2023-11-14 22:13:20 UTC.
const START: u64 = 1_700_000_000 * SECOND;

fn health(n: usize, word: &str) -> Health {
    let mut health = Health {
        actuator: format!("ema{n}"),
        window: 7,
        t_start_ns: START,
        status: "ok".to_owned(),
        health: word.to_owned(),
        residual_rms_a: Some(0.041),
        ..Health::default()
    };
    health.set_estimate(Some(&Estimate {
        k: [0.4, 0.1, 0.0, 0.15, 0.0, 0.0, 0.77, 0.5],
        sigma: std::array::from_fn(|n| (n != 6).then_some(0.005)),
        observable: [true, true, true, true, true, true, false, true],
    }));
    health.set_damage([Some(0.4), Some(0.1), Some(0.0), Some(0.15), None, None, Some(0.0)]);
    health
}

fn rul(n: usize) -> Rul {
    Rul {
        actuator: format!("ema{n}"),
        window: 7,
        operating_h: Some(1600.0),
        operating_cycles: Some(17.0),
        rul_p10_h: Some(579.0),
        rul_p50_h: Some(651.0),
        rul_p90_h: Some(728.0),
        failure_probability: Some(0.01),
        horizon_h: Some(100.0),
        governed_by: "damage".to_owned(),
        dominant_fault: "friction".to_owned(),
        ..Rul::default()
    }
}

fn window(n: usize) -> Window {
    Window {
        actuator: format!("ema{n}"),
        window: 7,
        samples: 799,
        samples_expected: 801,
        measured_i_q_a: vec![1.0; 801],
        ..Window::default()
    }
}

/// Of a live run: who is stale, by number.
fn status(actuators: usize, stale: &[usize]) -> Status {
    let interface = |name: &str, bus_state: &str, link: &str| InterfaceStatus {
        interface: name.to_owned(),
        bus_state: bus_state.to_owned(),
        link: link.to_owned(),
        passive: false,
    };
    let actuator = |n: usize| ActuatorStatus {
        actuator: format!("ema{n}"),
        data_age_s: if stale.contains(&n) { 3.0 } else { 0.4 },
        data_state: if stale.contains(&n) { "STALE" } else { "fresh" }.to_owned(),
        health: "nominal".to_owned(),
        ..ActuatorStatus::default()
    };
    Status {
        frames_received: 1234,
        lost_samples: 3,
        windows_ok: 7,
        interfaces: vec![
            interface("can0", "error-active", "up"),
            interface("can1", "error-passive", "down"),
        ],
        queued_inputs: 5,
        storage: "ok".to_owned(),
        storage_free_bytes: 4_000_000_000,
        actuators: (0..actuators).map(actuator).collect(),
        ..Status::default()
    }
}

/// What is made of a file with these records.
fn state(write: impl FnOnce(&mut McapWriter<Bytes<Vec<u8>>>)) -> State {
    let mut writer = McapWriter::new(Bytes::new(Vec::new()), &Default::default()).unwrap();
    write(&mut writer);
    let file = writer.finish().unwrap().0.into_inner();
    let mut state = State::default();
    for message in McapMessages::new(Bytes::new(file), "test").unwrap() {
        state.add_message(&message.unwrap());
    }
    state
}

/// A live run of so many actuators, the last of them critical, the first with stale data.
fn fleet(actuators: usize) -> State {
    state(|writer| {
        for n in 0..actuators {
            let word = if n + 1 == actuators { "critical" } else { "nominal" };
            writer.write(START, &window(n)).unwrap();
            writer.write(START, &health(n, word)).unwrap();
            writer.write(START, &rul(n)).unwrap();
        }
        for (n, level) in [LogLevel::Info, LogLevel::Warning, LogLevel::Error]
            .into_iter()
            .enumerate()
        {
            let at = START + n as u64 * SECOND;
            writer
                .write(at, &Log::new(at, level, "hmd", &format!("event {n}")))
                .unwrap();
        }
        writer.write(START + 10 * SECOND, &status(actuators, &[0])).unwrap();
    })
}

fn screen(model: &Model<'_>, row: usize, size: (u16, u16), colours: Colours) -> Terminal<TestBackend> {
    let mut terminal = Terminal::new(TestBackend::new(size.0, size.1)).unwrap();
    let draws = |frame: &mut ratatui::Frame<'_>| {
        draw(model, Cursor { row, keys: true }, colours, frame.buffer_mut());
    };
    terminal.draw(draws).unwrap();
    terminal
}

fn text(terminal: &Terminal<TestBackend>) -> Vec<String> {
    let buffer = terminal.backend().buffer();
    let line = |y| {
        (0..buffer.area.width)
            .map(|x| buffer[(x, y)].symbol())
            .collect::<String>()
    };
    (0..buffer.area.height).map(|y| line(y).trim_end().to_owned()).collect()
}

fn shown(actuators: usize, row: usize, size: (u16, u16)) -> Vec<String> {
    let state = fleet(actuators);
    let model = Model::new("/records", &state, Condition::Live(2.0), false);
    text(&screen(&model, row, size, Colours::On))
}

#[test]
fn six_actuators_fill_a_small_terminal() {
    let expected = [
        "hmd top  LIVE, newest record written 2 s ago  /records",
        "6 actuators  1 critical  5 nominal  1 STALE",
        "buses    can1 DOWN, can0 OK; queues 5 inputs, 0 windows; storage ok, 4 GB free",
        "lost     3 samples; frames 1234, windows 7 ok",
        "  ACTUATOR   DATA         HEALTH    LEFT, h (10..90 %) LARGEST DAMAGE        AGO",
        "  ema0       STALE 5 s    nominal   651 (579..728)     friction      40 %   12 s",
        "  ema1       fresh        nominal   651 (579..728)     friction      40 %   12 s",
        "  ema2       fresh        nominal   651 (579..728)     friction      40 %   12 s",
        "  ema3       fresh        nominal   651 (579..728)     friction      40 %   12 s",
        "  ema4       fresh        nominal   651 (579..728)     friction      40 %   12 s",
        "> ema5       fresh        critical  651 (579..728)     friction      40 %   12 s",
        "-- ema5 ------------------------------------------------------------------------",
        "k1 friction [####......] 0.400 +-0.010  k5 short C  [..........] 0.000 +-0.010",
        "k2 backlash [#.........] 0.100 +-0.010  k6 eccentr. [..........] 0.000 +-0.010",
        "k3 short A  [..........] 0.000 +-0.010  k7 ecc.dir. [          ] not shown",
        "k4 short B  [##........] 0.150 +-0.010  k8 gain     [#####.....] 0.500 +-0.010",
        "window   7 ok, began 2023-11-14 22:13, 799 of 801 samples, residual 0.041 A",
        "left     651 h, 80 % in 579..728 h, by damage of friction; P 0.01 in 100 h",
        "used     1600.0 h, 17.0 cycles",
        "",
        "-- last events, UTC ------------------------------------------------------------",
        "2023-11-14 22:13:21 WARN  event 1",
        "2023-11-14 22:13:22 ERROR event 2",
        "Up/Down select  PgUp/PgDn  w worst first  q quit",
    ];
    assert_eq!(shown(6, 5, (80, 24)), expected);
}

#[test]
fn one_actuator_leaves_room_for_events_and_many_are_turned_by_pages() {
    let one = shown(1, 0, (80, 24)).join("\n");
    assert!(
        one.contains("1 actuator  1 critical  1 STALE") && one.contains("event 0"),
        "{one}"
    );

    let many = shown(48, 0, (80, 24)).join("\n");
    assert!(
        many.contains("> ema0 ") && many.contains("48 actuators, 1-6 shown") && !many.contains("  ema6 "),
        "{many}"
    );
    let last = shown(48, 47, (80, 24)).join("\n");
    assert!(
        last.contains("> ema47 ") && last.contains("43-48 shown") && !last.contains("ema41 "),
        "{last}"
    );
    let tall = shown(48, 0, (120, 80)).join("\n");
    assert!(tall.contains("  ema47 ") && tall.contains("event 0"), "{tall}");
}

#[test]
fn any_size_is_drawn() {
    for actuators in [0, 1, 6, 48] {
        let state = fleet(actuators);
        let model = Model::new("/records", &state, Condition::Live(2.0), false);
        for (width, height) in [(1, 1), (20, 4), (60, 8), (60, 12), (80, 18), (80, 25), (300, 100)] {
            let row = actuators.saturating_sub(1);
            let text = text(&screen(&model, row, (width, height), Colours::On)).join("\n");
            if width >= WIDTH_MIN && height >= HEIGHT_MIN && actuators > 0 {
                assert!(text.contains(&format!("> ema{row}")), "{width}x{height}: {text}");
            }
        }
    }
    let small = shown(1, 0, (70, 7)).join("\n");
    assert!(small.contains("60x8 needed, q ends"), "{small}");
}

#[test]
fn no_state_is_shown_by_colour_alone() {
    let state = fleet(2);
    let model = Model::new("/records", &state, Condition::Silent(40.0), false);
    let coloured = screen(&model, 0, (80, 24), Colours::On);
    let plain = screen(&model, 0, (80, 24), Colours::Off);
    assert_eq!(text(&coloured), text(&plain));
    let cells = |terminal: &Terminal<TestBackend>| terminal.backend().buffer().content().to_vec();
    let basic = [Color::Reset, Color::Red, Color::Green, Color::Yellow, Color::Cyan];
    assert!(
        cells(&coloured)
            .iter()
            .all(|cell| basic.contains(&cell.fg) && cell.bg == Color::Reset)
    );
    assert!(cells(&coloured).iter().any(|cell| cell.fg == Color::Red));
    assert!(
        cells(&plain)
            .iter()
            .all(|cell| cell.fg == Color::Reset && cell.bg == Color::Reset)
    );
    assert!(
        cells(&plain)
            .iter()
            .any(|cell| cell.modifier.contains(Modifier::REVERSED))
    );
    assert!(text(&plain).iter().all(|line| line.is_ascii()));
}

#[test]
fn records_that_are_no_longer_written_are_stale() {
    let state = fleet(2);
    let of = |condition| Model::new("/records", &state, condition, false).rows[1].freshness;
    assert_eq!(of(Condition::new(Progress::Waiting, 2.0)), Freshness::Fresh);
    let silent = Condition::new(Progress::Waiting, NEWS_MAX_S + 1.0);
    assert_eq!(silent, Condition::Silent(NEWS_MAX_S + 1.0));
    assert_eq!(of(silent), Freshness::Stale(0.4 + NEWS_MAX_S + 1.0));
    assert_eq!(of(Condition::new(Progress::Closed, 60.0)), Freshness::Stale(60.4));
    assert_eq!(
        of(Condition::new(Progress::Finished, 1e6)),
        Freshness::Fresh,
        "so it was at its end"
    );
    let model = Model::new("/records", &state, silent, false);
    let text = text(&screen(&model, 0, (80, 24), Colours::On)).join("\n");
    assert!(text.starts_with("hmd top  SILENT: nothing written for 16 s"), "{text}");
    assert!(text.contains("2 STALE"), "{text}");
}

#[test]
fn the_worst_stand_first_when_asked_for() {
    let state = fleet(3);
    let names = |worst_first| {
        let model = Model::new("/records", &state, Condition::Live(1.0), worst_first);
        model.rows.iter().map(|row| row.name.to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(names(false), ["ema0", "ema1", "ema2"]);
    assert_eq!(names(true), ["ema2", "ema0", "ema1"]);
}

#[test]
fn an_invalid_window_keeps_the_estimate_of_the_last_good_one_and_reports_it() {
    let state = state(|writer| {
        writer.write(START, &health(0, "watch")).unwrap();
        writer.write(START, &rul(0)).unwrap();
        let invalid = Health {
            window: 8,
            status: "invalid".to_owned(),
            reason: "start in motion".to_owned(),
            ..health(0, "watch")
        };
        let mut invalid = Health { k1: None, ..invalid };
        invalid.set_damage([None; 7]);
        writer.write(START + SECOND, &invalid).unwrap();
    });
    let model = Model::new("a.mcap", &state, Condition::Recorded, false);
    let text = text(&screen(&model, 0, (80, 24), Colours::On)).join("\n");
    assert!(
        text.contains("window   8 invalid (start in motion), k of window 7"),
        "{text}"
    );
    assert!(
        text.contains("k1 friction [####......] 0.400") && text.contains("friction      40 %"),
        "{text}"
    );
    assert!(text.contains("left     unknown"), "its own life has not come: {text}");
    assert!(text.contains("RECORDED until 2023-11-14 22:13 UTC"), "{text}");
}

#[test]
fn hostile_records_are_bounded_and_harmless() {
    let state = state(|writer| {
        for n in 0..1100 {
            writer.write(START, &health(n, "nominal")).unwrap();
        }
        for n in 0..1000 {
            let text = format!("{n}\x1b[2J\r\n{}", "x".repeat(1000));
            writer
                .write(START, &Log::new(START, LogLevel::Error, "", &text))
                .unwrap();
        }
        let odd = Health {
            k1: Some(f64::NAN),
            k2: Some(1e300),
            ..health(0, "sleepy")
        };
        writer.write(START, &odd).unwrap();
    });
    assert_eq!(
        (state.names().len(), state.events().len(), state.refused),
        (1024, 100, 76)
    );
    let model = Model::new("a\x1bb", &state, Condition::Recorded, true);
    let text = text(&screen(&model, 0, (80, 24), Colours::On)).join("\n");
    assert!(!text.contains('\x1b'), "{text}");
}

#[test]
fn a_damage_that_the_newest_window_does_not_show_is_still_the_largest() {
    let state = state(|writer| {
        writer.write(START, &health(0, "watch")).unwrap();
        let mut later = health(0, "watch");
        later.window = 8;
        later.set_damage([None, Some(0.1), None, None, None, None, None]);
        writer.write(START + SECOND, &later).unwrap();
    });
    let model = Model::new("test", &state, Condition::Recorded, true);
    assert_eq!(model.rows[0].worst, Some(("friction", 0.4)));
}

//! Pages of the book that are written from the code: they stand in git, and must be what the code says.
//!
//! `UPDATE_PAGES=1 cargo test -p hmd --test pipeline pages` writes them again.

use std::fmt::Write;
use std::path::Path;

use ema_models::FaultId;
use hmd_core::health::HealthState;
use hmd_core::metrics::last_windows::LastWindows;
use hmd_core::metrics::render;
use hmd_core::record::{
    ActuatorStatus, Assessed, Dropped, Ended, Health, InterfaceStatus, Log, RawBatch, Record, Rul, Sensors, Shortened,
    Status, Window,
};
use hmd_core::windows_in_a_row::WindowsInARow;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FileDescriptorProto};

/// Stands for the names that a label may have.
const ANY: &str = "ANY";

fn check(name: &str, made: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs").join(name);
    if std::env::var_os("UPDATE_PAGES").is_some() {
        std::fs::write(&path, made).expect(name);
    }
    let found = std::fs::read_to_string(&path).expect(name);
    assert!(
        found == made,
        "docs/{name} is not what the code says; UPDATE_PAGES=1 cargo test -p hmd --test pipeline pages writes it again"
    );
}

#[test]
fn metrics() {
    let mut last = LastWindows::new(ANY.to_owned());
    let mut health = Health {
        actuator: ANY.to_owned(),
        ..Health::default()
    };
    health.set_damage([Some(0.0); FaultId::COUNT]);
    health.set_states(&[HealthState::Unknown; FaultId::COUNT]);
    [health.k1_sigma, health.k2_sigma, health.k3_sigma, health.k4_sigma] = [Some(0.0); 4];
    [health.k5_sigma, health.k6_sigma, health.k8_sigma] = [Some(0.0); 3];
    let rul = Rul {
        rul_p10_h: Some(0.0),
        rul_p50_h: Some(0.0),
        rul_p90_h: Some(0.0),
        ..Rul::default()
    };
    let in_a_row = WindowsInARow {
        suspects: [(ANY.to_owned(), 0)].into(),
        ..WindowsInARow::default()
    };
    last.update(&health, &rul, &in_a_row);
    let status = Status {
        record_age_s: Some(0.0),
        interfaces: vec![InterfaceStatus {
            interface: ANY.to_owned(),
            ..InterfaceStatus::default()
        }],
        storage: "ok".to_owned(),
        actuators: vec![ActuatorStatus {
            actuator: ANY.to_owned(),
            ..ActuatorStatus::default()
        }],
        ..Status::default()
    };
    let text = render(&status, &last);
    let mut page = "# Metrics\n\nWhat `hmd run --metrics` and `--metrics-listen` give ([deploy.md](deploy.md)); made from the code.\n\
        What is by the last window stands again from the start of the daemon on, where histories are kept (`rul.state`).\n\n\
        | metric | type | labels | what |\n|---|---|---|---|\n"
        .to_owned();
    let mut lines = text.lines().filter(|line| *line != "# EOF").peekable();
    while let Some(line) = lines.next() {
        let (name, help) = line
            .strip_prefix("# HELP ")
            .and_then(|rest| rest.split_once(' '))
            .unwrap_or_else(|| panic!("expected a # HELP line, found {line}"));
        let kind = lines
            .next()
            .and_then(|line| line.rsplit_once(' '))
            .expect("a # TYPE line")
            .1;
        let suffix = if kind == "counter" { "_total" } else { "" };
        // Its labels stand nowhere else.
        assert!(
            lines.peek().is_some_and(|line| !line.starts_with('#')),
            "expected a sample of {name}, found none: fill what it shows into the record above"
        );
        let mut labels: Vec<(&str, Vec<&str>)> = Vec::new();
        while let Some(sample) = lines.next_if(|line| !line.starts_with('#')) {
            let Some((_, rest)) = sample.split_once('{') else {
                continue;
            };
            let (pairs, _) = rest.split_once('}').expect("the end of the labels");
            // A value may have a comma in it.
            for pair in pairs.trim_end_matches('"').split("\",") {
                let (key, value) = pair.split_once("=\"").expect("a label");
                let known = labels.iter().position(|(known, _)| *known == key);
                let at = known.unwrap_or(labels.len());
                if known.is_none() {
                    labels.push((key, Vec::new()));
                }
                if value != ANY && key != "version" && !labels[at].1.contains(&value) {
                    labels[at].1.push(value);
                }
            }
        }
        let mut label = String::new();
        for (key, values) in labels {
            let comma = if label.is_empty() { "" } else { "; " };
            write!(label, "{comma}`{key}`").expect("a String");
            for (n, value) in values.iter().enumerate() {
                write!(label, "{} `{value}`", if n == 0 { ":" } else { "," }).expect("a String");
            }
        }
        let help = help.trim_end_matches('.');
        writeln!(page, "| `{name}{suffix}` | {kind} | {label} | {help} |").expect("a String");
    }
    check("metrics.md", &page);
}

#[test]
fn fields() {
    let begin = "// Written from the code by a test (CONTRIBUTING.md); what the fields mean is in docs/records.md.\n\nsyntax = \"proto3\";\n";
    let mut ours = format!("{begin}package hmd.v1;\n");
    fields_of::<RawBatch>(&mut ours);
    fields_of::<Window>(&mut ours);
    fields_of::<Health>(&mut ours);
    fields_of::<Rul>(&mut ours);
    fields_of::<Sensors>(&mut ours);
    fields_of::<Assessed>(&mut ours);
    fields_of::<Ended>(&mut ours);
    fields_of::<Dropped>(&mut ours);
    fields_of::<Shortened>(&mut ours);
    fields_of::<Status>(&mut ours);
    check("schemas/hmd.v1.proto", &ours);
    let mut log = format!("{begin}package foxglove;\nimport \"google/protobuf/timestamp.proto\";\n");
    fields_of::<Log>(&mut log);
    check("schemas/foxglove.Log.proto", &log);
}

/// A record in the language of schemas, then the messages that its fields are lists of.
fn fields_of<R: Record>(page: &mut String) {
    let set = R::descriptor();
    let is_own = |file: &&FileDescriptorProto| R::SCHEMA_NAME.starts_with(&format!("{}.", file.package()));
    let own = set.file.iter().find(is_own).expect("the file of the record");
    assert!(R::SCHEMA_NAME.ends_with(own.message_type[0].name()));
    for message in &own.message_type {
        write_message(page, message);
    }
}

/// A message, with the enums inside it.
fn write_message(page: &mut String, message: &DescriptorProto) {
    writeln!(page, "\nmessage {} {{", message.name()).expect("a String");
    for inner in &message.enum_type {
        writeln!(page, "  enum {} {{", inner.name()).expect("a String");
        for value in &inner.value {
            writeln!(page, "    {} = {};", value.name(), value.number()).expect("a String");
        }
        writeln!(page, "  }}").expect("a String");
    }
    for field in &message.field {
        let kind = match field.r#type() {
            Type::Message | Type::Enum => field.type_name().trim_start_matches('.').to_owned(),
            other => other.as_str_name().trim_start_matches("TYPE_").to_lowercase(),
        };
        let presence = match (field.label(), field.proto3_optional()) {
            (Label::Repeated, _) => "repeated ",
            (_, true) => "optional ",
            _ => "",
        };
        writeln!(page, "  {presence}{kind} {} = {};", field.name(), field.number()).expect("a String");
    }
    writeln!(page, "}}").expect("a String");
}

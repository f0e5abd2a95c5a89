//! Pages of the book that are written from the code: they stand in git, and must be what the code says.
//!
//! `UPDATE_PAGES=1 cargo test -p hmd --test pipeline pages` writes them again.

use std::fmt::Write;
use std::path::Path;

use hmd_core::metrics::render;
use hmd_core::record::{Dropped, Health, Log, RawBatch, Record, Rul, Status, Window};
use prost_types::field_descriptor_proto::{Label, Type};

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
    let any = || vec![ANY.to_owned()];
    let text = render(&Status {
        record_age_s: Some(0.0),
        interface: any(),
        link: vec!["up".to_owned()],
        actuator: any(),
        data_age_s: vec![0.0],
        data_state: vec!["ok".to_owned()],
        health: vec!["ok".to_owned()],
        persistence: vec![0],
        passive: vec![false],
        ..Status::default()
    });
    let mut page = "# Metrics\n\nWhat `hmd run --metrics` and `--metrics-listen` give ([deploy.md](deploy.md)); made from the code.\n\n\
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
        let mut label = String::new();
        while let Some(sample) = lines.next_if(|line| !line.starts_with('#')) {
            let Some((_, rest)) = sample.split_once('{') else {
                continue;
            };
            let (key, value) = rest.split_once("=\"").expect("a label");
            let value = value.split('"').next().unwrap_or_default();
            if label.is_empty() {
                write!(label, "`{key}`").expect("a String");
            }
            if value != ANY {
                let comma = if label.contains(':') { "," } else { ":" };
                write!(label, "{comma} `{value}`").expect("a String");
            }
        }
        let help = help.trim_end_matches('.');
        writeln!(page, "| `{name}{suffix}` | {kind} | {label} | {help} |").expect("a String");
    }
    check("metrics.md", &page);
}

#[test]
fn fields() {
    let mut page = "# Schemas of the records\n\nAll messages as the schemas in a file have them; made from the code. What the fields \
        mean is in [records.md](records.md).\n\n```proto\nsyntax = \"proto3\";\npackage hmd.v1;\n"
        .to_owned();
    fields_of::<RawBatch>(&mut page);
    fields_of::<Window>(&mut page);
    fields_of::<Health>(&mut page);
    fields_of::<Rul>(&mut page);
    fields_of::<Dropped>(&mut page);
    fields_of::<Status>(&mut page);
    page += "```\n\n```proto\nsyntax = \"proto3\";\npackage foxglove;\nimport \"google/protobuf/timestamp.proto\";\n";
    fields_of::<Log>(&mut page);
    page += "```\n";
    check("fields.md", &page);
}

/// A message in the language of schemas, with the enums inside it.
fn fields_of<R: Record>(page: &mut String) {
    let set = R::descriptor();
    let messages = set.file.iter().flat_map(|file| {
        let package = file.package().to_owned();
        file.message_type
            .iter()
            .map(move |message| (format!("{package}.{}", message.name()), message))
    });
    let (_, message) = messages
        .into_iter()
        .find(|(name, _)| name == R::SCHEMA_NAME)
        .expect("the message in its own descriptor");
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

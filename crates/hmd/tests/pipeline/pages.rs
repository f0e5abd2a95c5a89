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
    let mut page = "# Fields of records\n\nNames, numbers and types of all fields, as the schemas in a file have them; made from the \
        code. What they mean, and their units, is in [records.md](records.md).\n"
        .to_owned();
    fields_of::<RawBatch>(&mut page);
    fields_of::<Window>(&mut page);
    fields_of::<Health>(&mut page);
    fields_of::<Rul>(&mut page);
    fields_of::<Dropped>(&mut page);
    fields_of::<Status>(&mut page);
    fields_of::<Log>(&mut page);
    check("fields.md", &page);
}

fn fields_of<R: Record>(page: &mut String) {
    write!(
        page,
        "\n## `{}`\n\n| number | field | type |\n|---|---|---|\n",
        R::SCHEMA_NAME
    )
    .expect("a String");
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
        writeln!(page, "| {} | `{}` | {presence}{kind} |", field.number(), field.name()).expect("a String");
    }
}

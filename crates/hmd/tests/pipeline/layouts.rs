//! The layouts for viewers name only what our schemas have.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::collections::BTreeSet;
use std::path::Path;

use hmd_core::record::{Health, Log, Record, Rul, Status, Window};
use prost_types::field_descriptor_proto::{Label, Type};
use serde_json::Value;

/// The actuator that the layouts are for.
const ACTUATOR: &str = "ema0";

fn layout(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../docs/viewers")
        .join(name);
    std::fs::read_to_string(path).unwrap()
}

/// Name, type and whether it is a list, of each field of the record on a topic.
type Fields = Vec<(String, Type, bool)>;

fn fields_of<R: Record>() -> Fields {
    let set = R::descriptor();
    let message = &set.file.last().unwrap().message_type[0];
    assert!(R::SCHEMA_NAME.ends_with(message.name()));
    let fields = message.field.iter();
    fields
        .map(|field| {
            (
                field.name().to_owned(),
                field.r#type(),
                field.label() == Label::Repeated,
            )
        })
        .collect()
}

/// The fields of a topic.
fn fields(topic: &str) -> Fields {
    let actuator = ACTUATOR.to_owned();
    let topics = [
        (
            Health {
                actuator: actuator.clone(),
                ..Health::default()
            }
            .topic(),
            fields_of::<Health>(),
        ),
        (
            Rul {
                actuator: actuator.clone(),
                ..Rul::default()
            }
            .topic(),
            fields_of::<Rul>(),
        ),
        (
            Window {
                actuator,
                ..Window::default()
            }
            .topic(),
            fields_of::<Window>(),
        ),
        (Status::default().topic(), fields_of::<Status>()),
        (Log::default().topic(), fields_of::<Log>()),
    ];
    let found = topics.into_iter().find(|(name, _)| name == topic);
    found.unwrap_or_else(|| panic!("no record goes to {topic}")).1
}

fn is_number(of: Type) -> bool {
    !matches!(of, Type::String | Type::Bytes | Type::Message)
}

/// The type of a field, which is a list or not.
fn field(topic: &str, name: &str, expect_list: bool) -> Type {
    let fields = fields(topic);
    let found = fields.iter().find(|(field, ..)| field == name);
    let (_, of, is_list) = found.unwrap_or_else(|| panic!("{topic} has no field {name}"));
    assert_eq!(*is_list, expect_list, "{topic} {name}");
    *of
}

/// A path as the panels of Foxglove and Lichtblick have it: `/topic.field` or `/topic.list[:]`.
fn path(text: &str) -> (String, Option<Type>) {
    let Some((topic, name)) = text.split_once('.') else {
        fields(text);
        return (text.to_owned(), None);
    };
    let of = match name.strip_suffix("[:]") {
        Some(list) => field(topic, list, true),
        None => field(topic, name, false),
    };
    (topic.to_owned(), Some(of))
}

/// All texts that begin with a slash.
fn paths(value: &Value) -> Vec<&str> {
    match value {
        Value::String(text) if text.starts_with('/') => vec![text],
        Value::Array(values) => values.iter().flat_map(paths).collect(),
        Value::Object(members) => members.values().flat_map(paths).collect(),
        _ => Vec::new(),
    }
}

/// Panels in the tree of a layout.
fn panels(tree: &Value) -> Vec<&str> {
    match tree {
        Value::String(panel) => vec![panel],
        split => ["first", "second"]
            .iter()
            .flat_map(|side| panels(&split[side]))
            .collect(),
    }
}

#[test]
fn the_layout_for_foxglove_names_what_is_recorded() {
    let layout: Value = serde_json::from_str(&layout("foxglove.json")).unwrap();
    let configured = layout["configById"].as_object().unwrap();
    let shown: BTreeSet<&str> = panels(&layout["layout"]).into_iter().collect();
    assert_eq!(
        shown,
        configured.keys().map(String::as_str).collect(),
        "every panel is shown once and set up"
    );
    let mut topics = BTreeSet::new();
    for (panel, config) in configured {
        let paths = paths(config);
        assert!(!paths.is_empty(), "{panel}");
        for text in paths {
            let (topic, of) = path(text);
            topics.insert(topic);
            if panel.starts_with("Plot!") {
                assert!(of.is_some_and(is_number), "{panel} draws numbers, found {text}");
            }
        }
    }
    let all = ["/ema0/health", "/ema0/rul", "/ema0/window", "/hmd/status", "/log"];
    assert_eq!(topics, all.map(str::to_owned).into());
}

#[test]
fn the_layout_for_plotjuggler_names_what_is_recorded() {
    let layout = layout("plotjuggler.xml");
    let curves: Vec<&str> = layout
        .split("<curve name=\"")
        .skip(1)
        .map(|rest| rest.split('"').next().unwrap())
        .collect();
    assert!(curves.len() > 30, "{curves:?}");
    for curve in curves {
        let (topic, name) = curve.rsplit_once('/').unwrap();
        // It draws no text, and an array as one curve for each place.
        assert!(is_number(field(topic, name, false)), "{curve}");
    }
    let count = |text: &str| layout.matches(text).count();
    for tag in ["Tab ", "Container", "DockSplitter ", "DockArea ", "plot ", "root"] {
        assert_eq!(count(&format!("<{tag}")), count(&format!("</{}>", tag.trim())), "{tag}");
    }
}

#[test]
#[should_panic(expected = "/ema0/health has no field damage_rust")]
fn a_field_that_is_not_there_is_found_out() {
    path("/ema0/health.damage_rust");
}

#[test]
#[should_panic(expected = "no record goes to /ema1/health")]
fn a_topic_that_is_not_there_is_found_out() {
    path("/ema1/health.k1");
}

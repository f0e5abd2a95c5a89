//! Where the page comes from: events and metadata of the files.

use super::files::{Files, Source};
use super::markup::table;
use super::plot::escaped;
use super::zone::Zone;

/// Most events that are listed, the newest.
const EVENTS_MAX: usize = 50;

/// Events of all actuators, the newest first.
pub(super) fn events(files: &Files, zone: &Zone) -> String {
    if files.events.is_empty() {
        return "<p>None recorded.</p>\n".to_owned();
    }
    let mut newest: Vec<&(u64, String)> = files.events.iter().collect();
    // Files of several actuators need not follow each other.
    newest.sort_by_key(|(t_ns, _)| std::cmp::Reverse(*t_ns));
    let newest = newest.into_iter().take(EVENTS_MAX);
    let rows: String = newest
        .map(|(t_ns, text)| format!("<tr><td>{}</td><td>{}</td></tr>\n", zone.minute(*t_ns), escaped(text)))
        .collect();
    let caption = format!("Newest first, {} in all", files.events.len());
    table(&caption, &[("Time", ""), ("Event", "")], &rows)
}

/// Metadata of each file.
pub(super) fn sources(files: &Files) -> String {
    let row = |source: &Source, key: &str, value: &str| {
        let (file, key, value) = (escaped(&source.file), escaped(key), escaped(value));
        format!("<tr><td>{file}</td><th scope=\"row\">{key}</th><td class=\"long\">{value}</td></tr>\n")
    };
    let rows: String = files
        .sources
        .iter()
        .flat_map(|source| source.metadata.iter().map(move |(key, value)| row(source, key, value)))
        .collect();
    let caption = format!("Metadata of each file; this page by hmd {}", env!("CARGO_PKG_VERSION"));
    table(&caption, &[("File", ""), ("Key", ""), ("Value", "")], &rows)
}

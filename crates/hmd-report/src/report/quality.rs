//! Quality of the data: windows by status and reason, and what the files lost.

use std::collections::BTreeMap;
use std::fmt::Write;

use hmd_core::counted::counted;
use hmd_core::record::{Status, WindowStatus};

use super::files::{Files, Source};
use super::history::History;
use super::markup::table;
use super::plot::escaped;

/// Most reasons of windows that are listed, the most frequent.
const REASONS_MAX: usize = 20;

/// Windows and samples of one actuator.
pub(super) fn windows(history: &History) -> String {
    let mut rows = String::new();
    let mut row = |what: &str, count: u64| {
        let _ = writeln!(
            rows,
            "<tr><th scope=\"row\">{}</th><td class=\"n\">{count}</td></tr>",
            escaped(what)
        );
    };
    for status in WindowStatus::ALL.map(WindowStatus::name) {
        let count = history.points.iter().filter(|point| point.status == status).count();
        row(&format!("windows {status}"), count as u64);
    }
    let [expected, received, missing] = history.samples;
    row("expected samples", expected);
    row("received samples", received);
    row("missing samples, by their counters", missing);
    let mut text = table("This actuator", &[("What", ""), ("Count", "n")], &rows);

    let mut reasons: Vec<(&String, &u64)> = history.reasons.iter().collect();
    reasons.sort_by(|a, b| b.1.cmp(a.1).then(a.0.cmp(b.0)));
    if !reasons.is_empty() {
        let rows: String = reasons
            .iter()
            .take(REASONS_MAX)
            .map(|(reason, count)| format!("<tr><td>{}</td><td class=\"n\">{count}</td></tr>\n", escaped(reason)))
            .collect();
        text += &table("Why windows were not ok", &[("Reason", ""), ("Windows", "n")], &rows);
    }
    text
}

/// What buses reported and what was lost, over all actuators of the files.
pub(super) fn losses(files: &Files) -> String {
    let mut text = String::new();
    let counted = newest_of_runs(&files.sources);
    let errors: String = counted
        .iter()
        .filter(|source| source.status.frames_error > 0)
        .map(|source| loss(&source.file, "error frames", &source.status.frames_error.to_string()))
        .collect();
    if !errors.is_empty() {
        text += &table("What the buses reported", &LOST, &errors);
    }
    let mut rows = String::new();
    for source in counted {
        for (cause, count) in source.status.losses().into_iter().filter(|(_, count)| *count > 0) {
            rows += &loss(&source.file, in_words(cause), &count.to_string());
        }
    }
    for source in files.sources.iter().filter(|source| source.damaged) {
        rows += &loss(&source.file, "parts of the recording are missing or damaged", "yes");
    }
    if rows.is_empty() {
        text + "<p>The files lost nothing: no frame, no sample, no window of any actuator.</p>\n"
    } else {
        text + &table("Lost, over all actuators", &LOST, &rows)
    }
}

/// Losses that may have cost whole windows, each in words: those of samples stand in the windows that there are.
pub(super) fn missing(files: &Files) -> Vec<String> {
    let mut found = Vec::new();
    if files.sources.iter().any(|source| source.damaged) {
        found.push("Parts of a recording are missing or damaged".to_owned());
    }
    let counted = newest_of_runs(&files.sources);
    let sum = |of: fn(&Status) -> u64| {
        counted
            .iter()
            .map(|source| of(&source.status))
            .fold(0, u64::saturating_add)
    };
    let of_logs = sum(|status| status.lost_damaged);
    if of_logs > 0 {
        found.push(format!("Damaged parts of the logs, {}, were not used", frames(of_logs)));
    }
    let late = sum(|status| status.lost_late);
    if late > 0 {
        found.push(format!(
            "{} were not used, as they are older by the clock than others before",
            frames(late)
        ));
    }
    let unused = sum(|status| status.lost_windows.saturating_add(status.lost_storage_records));
    if unused > 0 {
        found.push("Not all windows were assessed and stored".to_owned());
    }
    found
}

fn frames(count: u64) -> String {
    counted(count, "frame", "frames")
}

/// The sources whose counts are not in those of a later one: the counts of a run go on from segment to segment.
fn newest_of_runs(sources: &[Source]) -> Vec<&Source> {
    let mut newest: Vec<&Source> = Vec::new();
    let mut of_run: BTreeMap<&str, usize> = BTreeMap::new();
    // One that was cut off may have none.
    for source in sources.iter().filter(|source| source.status != Status::default()) {
        let run = source.metadata.get("run");
        match run.and_then(|run| of_run.get(run.as_str())) {
            Some(n) => newest[*n] = source,
            None => {
                of_run.extend(run.map(|run| (run.as_str(), newest.len())));
                newest.push(source);
            }
        }
    }
    newest
}

/// Heads of the rows of [`loss`].
const LOST: [(&str, &str); 3] = [("File", ""), ("What", ""), ("Count", "n")];

fn loss(file: &str, what: &str, count: &str) -> String {
    let file = escaped(file);
    format!("<tr><td>{file}</td><td>{what}</td><td class=\"n\">{count}</td></tr>\n")
}

/// A cause of [`crate::record::Status::losses`], as `docs/records.md` explains it.
fn in_words(cause: &'static str) -> &'static str {
    match cause {
        "unreadable" => "unreadable lines or serial frames",
        "damaged" => "frames in damaged parts",
        "socket_queue" => "frames dropped by the kernel",
        "malformed" => "malformed frames",
        "late" => "late frames",
        "windows" => "windows not assessed",
        "storage_frames" => "frames not stored",
        "storage_records" => "records not stored",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_run_lost_is_counted_once() {
        let segment = |run: &str, file: &str, lost_samples| Source {
            file: file.to_owned(),
            metadata: [("run".to_owned(), run.to_owned())].into(),
            status: Status {
                lost_samples,
                ..Status::default()
            },
            ..Source::default()
        };
        let files = Files {
            sources: vec![
                segment("a", "1", 5),
                segment("a", "2", 7),
                segment("b", "3", 9),
                segment("a", "4", 0),
            ],
            ..Files::default()
        };
        let text = losses(&files);
        let has = |count: u64| text.contains(&format!("<td class=\"n\">{count}</td>"));
        assert_eq!([5, 7, 9].map(has), [false, true, true], "{text}");
    }

    #[test]
    fn every_cause_of_loss_has_a_text() {
        // None is the name of a field with its underscore.
        let causes = Status::default().losses().map(|(cause, _)| in_words(cause));
        assert!(causes.iter().all(|text| !text.contains('_')), "{causes:?}");
    }
}

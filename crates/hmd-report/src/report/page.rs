//! The page: headings, tables and plots in the order in which they are read.

use ema_models::FaultId;
use std::fmt::Write;

use super::history::{Files, History, Source};
use super::markup::{document, table};
use super::plot::escaped;
use super::sections::{fault_vector, fit, remaining, residuals, timeline};
use hmd_core::record::{Rul, WindowStatus};
use hmd_core::timestamp;

/// Most events that are listed, the newest.
const EVENTS_MAX: usize = 50;

/// Most reasons of windows that are listed, the most frequent.
const REASONS_MAX: usize = 20;

/// The report of one actuator as one HTML file.
#[must_use]
pub fn page(files: &Files, history: &History) -> String {
    let name = escaped(&history.actuator);
    let mut body = format!(
        "<h1>Health report of {name}</h1>\n{}{}",
        period(history),
        assessment(history)
    );
    let mut section = |heading: &str, content: String| {
        let _ = writeln!(body, "<section><h2>{heading}</h2>\n{content}</section>");
    };
    section("Faults", faults(history));
    section(
        "Health and remaining life",
        format!("<div class=\"plots\">{}{}</div>", timeline(history), remaining(history)),
    );
    section(
        "Fault vector",
        format!("<div class=\"plots\">{}</div>", fault_vector(history)),
    );
    section("Measured against fitted", fitted(history));
    section("Data quality", quality(files, history));
    section("Events", events(files));
    section("How this was made", sources(files));
    document(&format!("Health report of {name}"), &body)
}

fn period(history: &History) -> String {
    let (Some(first), Some(last)) = (history.points.first(), history.points.last()) else {
        return String::new();
    };
    format!(
        "<p class=\"faint\">{} windows from {} to {} UTC</p>\n",
        history.points.len(),
        timestamp::minute(first.t_start_ns),
        timestamp::minute(last.t_start_ns)
    )
}

/// State, what is left, and why.
fn assessment(history: &History) -> String {
    let (health, rul) = &history.newest;
    let state = escaped(&health.health);
    format!(
        "<p class=\"assessment {state}\"><strong>{state}</strong><br>{}</p>\n",
        escaped(&left(rul))
    )
}

fn left(rul: &Rul) -> String {
    let (Some(p10), Some(p50), Some(p90)) = (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) else {
        let reason = if rul.reason.is_empty() {
            "none recorded"
        } else {
            &rul.reason
        };
        return format!("Remaining life: no number; {reason}.");
    };
    let mut text = format!("Remaining life {p50:.0} h, with 80 % probability between {p10:.0} and {p90:.0} h");
    if let (Some(probability), Some(horizon)) = (rul.failure_probability, rul.horizon_h) {
        let _ = write!(
            text,
            "; it ends within {horizon:.0} h with {:.1} % probability",
            100.0 * probability
        );
    }
    let _ = write!(
        text,
        ". Dominant fault: {}; the end is by {}.",
        words(&rul.dominant_fault),
        words(&rul.governed_by)
    );
    text
}

fn words(name: &str) -> String {
    if name.is_empty() {
        "none".to_owned()
    } else {
        name.replace('_', " ")
    }
}

/// Damage of each fault, and what is left to it alone.
fn faults(history: &History) -> String {
    let (health, rul) = &history.newest;
    let remaining = rul.faults();
    let mut rows = String::new();
    for ((name, damage), hours) in FaultId::NAMES.iter().zip(history.newest.0.damages()).zip(remaining) {
        let damage = damage.map_or_else(|| "not known".to_owned(), |d| format!("{:.1} %", 100.0 * d));
        let detected = if health.fault_list.iter().any(|fault| fault == name) {
            "yes"
        } else {
            "no"
        };
        let left = hours.map_or_else(
            || "no trend".to_owned(),
            |[p10, p50, p90]| format!("{p50:.0} ({p10:.0} … {p90:.0})"),
        );
        let _ = writeln!(
            rows,
            "<tr><th scope=\"row\">{}</th><td class=\"n\">{damage}</td><td>{detected}</td><td class=\"n\">{left}</td></tr>",
            words(name)
        );
    }
    table(
        "After the newest window; hours left to each fault alone, median and 80 % interval",
        &[("Fault", ""), ("Damage", "n"), ("Detected", ""), ("Hours left", "n")],
        &rows,
    )
}

fn fitted(history: &History) -> String {
    match &history.fitted {
        None => "<p>No recorded window was fitted.</p>\n".to_owned(),
        Some(window) => format!(
            "<p>Window {}, {} UTC, status {}: {} samples at {:.0} Hz.</p>\n<div class=\"plots\">{}{}</div>\n",
            window.window,
            timestamp::minute(window.t_start_ns),
            escaped(&window.status),
            window.samples,
            window.sample_rate_hz,
            fit(window),
            residuals(history),
        ),
    }
}

fn quality(files: &Files, history: &History) -> String {
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
    row("samples called for by rate and length", expected);
    row("samples received", received);
    row("samples missing by their counters", missing);
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
    let errors: String = files
        .sources
        .iter()
        .filter(|source| source.status.frames_error > 0)
        .map(|source| loss(&source.file, "error frames", &source.status.frames_error.to_string()))
        .collect();
    if !errors.is_empty() {
        text += &table("What the buses reported", &LOST, &errors);
    }
    let mut rows = String::new();
    for source in &files.sources {
        for (cause, count) in source.status.losses().into_iter().filter(|(_, count)| *count > 0) {
            rows += &loss(&source.file, in_words(cause), &count.to_string());
        }
        if source.damaged {
            rows += &loss(&source.file, "parts of the file are damaged", "yes");
        }
    }
    if rows.is_empty() {
        text + "<p>The files lost nothing: no frame, no sample, no window of any actuator.</p>\n"
    } else {
        text + &table("Lost, over all actuators", &LOST, &rows)
    }
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

fn events(files: &Files) -> String {
    if files.events.is_empty() {
        return "<p>None recorded.</p>\n".to_owned();
    }
    let newest = files.events.iter().rev().take(EVENTS_MAX);
    let rows: String = newest
        .map(|(t_ns, text)| {
            format!(
                "<tr><td>{}</td><td>{}</td></tr>\n",
                timestamp::minute(*t_ns),
                escaped(text)
            )
        })
        .collect();
    let caption = format!("Newest first, {} in all", files.events.len());
    table(&caption, &[("UTC", ""), ("Event", "")], &rows)
}

fn sources(files: &Files) -> String {
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

#[cfg(test)]
mod tests {
    use super::super::history::Point;
    use super::*;
    use hmd_core::record::{Estimate, Health, Status};

    fn history(windows: u64) -> History {
        let point = |n: u64| Point {
            window: n,
            t_start_ns: n * 3_600_000_000_000,
            status: "ok".to_owned(),
            health: "watch".to_owned(),
            estimate: Some(Estimate {
                k: [0.1; 8],
                sigma: [Some(0.01); 8],
                observable: [true; 8],
            }),
            residual_rms_a: Some(0.05),
            used_h: Some(n as f64),
            left_h: (n > 5).then_some([90.0, 100.0, 110.0]),
        };
        History {
            actuator: "<script>alert(1)</script>".to_owned(),
            points: (0..windows).map(point).collect(),
            ..History::default()
        }
    }

    #[test]
    fn a_long_history_stays_small_and_no_text_becomes_markup() {
        let mut history = history(20_000);
        history.newest.0 = Health {
            health: "watch".to_owned(),
            ..Health::default()
        };
        history.reasons.insert("<b>".to_owned(), 3);
        let files = Files {
            events: vec![(0, "<img src=x>".to_owned()); 1000],
            ..Files::default()
        };
        let text = page(&files, &history);
        assert!(text.len() < 1 << 20, "{} bytes", text.len());
        for forbidden in ["<script", "<img", "<b>", "http://", "https://", "NaN", "inf "] {
            assert!(!text.contains(forbidden), "{forbidden}");
        }
    }

    #[test]
    fn every_loss_is_reported_and_an_error_frame_is_none() {
        let of = |status| {
            let source = Source {
                status,
                ..Source::default()
            };
            let files = Files {
                sources: vec![source],
                ..Files::default()
            };
            page(&files, &history(1))
        };
        let errors = of(Status {
            frames_error: 3,
            ..Status::default()
        });
        assert!(errors.contains("<td>error frames</td><td class=\"n\">3</td>"));
        assert!(
            errors.contains("The files lost nothing"),
            "as the exit code and the metrics have it"
        );
        // Every cause has a text of its own: none is the name of a field with its underscore.
        let causes = Status::default().losses().map(|(cause, _)| in_words(cause));
        assert!(causes.iter().all(|text| !text.contains('_')), "{causes:?}");
    }

    #[test]
    fn a_history_of_nothing_makes_a_page_all_the_same() {
        let text = page(&Files::default(), &history(0));
        assert!(text.contains("No recorded window was fitted") && text.ends_with("</html>\n"));
    }
}

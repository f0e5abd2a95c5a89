//! The page: an overview where there are several actuators, a part for each, and what belongs to the files.

use std::fmt::Write;

use ema_models::FaultId;
use hmd_core::health::Levels;

use super::fault_table::faults;
use super::files::Files;
use super::history::History;
use super::markup::document;
use super::overview::overview;
use super::plot::escaped;
use super::quality::{losses, missing, windows};
use super::recommendation::recommendation;
use super::rules::Rules;
use super::sections::{damages, fit, legend, remaining, residuals, timeline};
use super::sources::{events, sources};
use super::summary::{headline, period};
use super::zone::Zone;

/// How a page is shown.
#[derive(Clone, Debug)]
pub struct View {
    /// Zone of the times.
    pub zone: Zone,
    /// Damage levels of the faults, in the order of [`FaultId::ALL`].
    pub levels: [Levels; FaultId::COUNT],
    /// An actuator is critical whose 10 % quantile of the hours left is below this; 0: never.
    pub critical_h: f64,
    /// Whether the windows were assessed by these levels, as far as is known.
    pub are_levels_of_windows: bool,
    /// A sentence about these levels, where they may be others than those of the recordings.
    pub notice: Option<String>,
}

/// The report of these actuators of the files as one HTML file.
#[must_use]
pub fn page(files: &Files, histories: &[&History], view: &View) -> String {
    let rules = Rules::new(&view.levels, view.critical_h, view.are_levels_of_windows);
    let title = match histories {
        [history] => format!("Health report of {}", escaped(&history.actuator)),
        _ => format!("Health report of {} actuators", histories.len()),
    };
    let mut body = format!("<h1>{title}</h1>\n");
    for what in missing(files) {
        let _ = writeln!(
            body,
            "<p class=\"assessment\">{what}: newer windows may be lost. See <em>Lost data</em>.</p>"
        );
    }
    if let Some(notice) = &view.notice {
        let _ = writeln!(body, "<p class=\"faint\">{}</p>", escaped(notice));
    }
    if histories.len() != 1 {
        body += &overview(histories, &rules, &view.zone);
    }
    for (n, history) in histories.iter().enumerate() {
        if histories.len() > 1 {
            let _ = write!(
                body,
                "<article id=\"actuator-{n}\">\n<h1>{}</h1>\n",
                escaped(&history.actuator)
            );
            body += &actuator(history, &rules, &view.zone);
            body += "</article>\n";
        } else {
            body += &actuator(history, &rules, &view.zone);
        }
    }
    body += &section("", "Lost data", &losses(files));
    body += &section("", "Events", &events(files, &view.zone));
    body += &section("", "How this was made", &sources(files));
    document(&title, &body)
}

/// A section; on paper its heading has the name of the actuator that it is of, for sheets that are parted.
fn section(of: &str, heading: &str, content: &str) -> String {
    let of = match of {
        "" => String::new(),
        name => format!("<span class=\"of\">, {}</span>", escaped(name)),
    };
    format!("<section><h2>{heading}{of}</h2>\n{content}</section>\n")
}

/// The part of the page about one actuator.
fn actuator(history: &History, rules: &Rules, zone: &Zone) -> String {
    let name = &history.actuator;
    let advice = recommendation(history, rules, zone);
    let plots = |plots: String| format!("{}<div class=\"plots\">{plots}</div>\n", legend(history, zone));
    [
        period(history, zone),
        headline(&advice, history, zone),
        section(name, "Faults", &faults(history, rules, zone)),
        section(
            name,
            "Damage over use",
            &format!(
                "<p>0 % is new. Green: nominal, below the watch level.</p>\n{}",
                plots(damages(history, &rules.modes))
            ),
        ),
        section(
            name,
            "Health and remaining life",
            &plots(format!("{}{}", timeline(history), remaining(history))),
        ),
        section(name, "Measured against fitted", &fitted(history, zone)),
        section(name, "Data quality", &windows(history)),
    ]
    .concat()
}

fn fitted(history: &History, zone: &Zone) -> String {
    match &history.fitted {
        None => "<p>No recorded window was fitted.</p>\n".to_owned(),
        Some(window) => format!(
            "<p>Window {}, {}, status {}: {} samples at {:.0} Hz.</p>\n<div class=\"plots\">{}{}</div>\n",
            window.window,
            zone.minute(window.t_start_ns),
            escaped(&window.status),
            window.samples,
            window.sample_rate_hz,
            fit(window),
            residuals(history),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::super::files::Source;
    use super::super::history::Point;
    use super::*;
    use hmd_core::health::HealthState;
    use hmd_core::record::{Estimate, Health, Status};

    fn view() -> View {
        View {
            zone: Zone::utc(),
            levels: [Levels::default(); FaultId::COUNT],
            critical_h: 0.0,
            are_levels_of_windows: true,
            notice: None,
        }
    }

    fn of_one(files: &Files, history: &History) -> String {
        page(files, &[history], &view())
    }

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
            ..Point::default()
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
        history.newest.health = Health {
            health: "watch".to_owned(),
            ..Health::default()
        };
        history.reasons.insert("<b>".to_owned(), 3);
        let files = Files {
            events: vec![(0, "<img src=x>".to_owned()); 1000],
            ..Files::default()
        };
        let text = of_one(&files, &history);
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
            of_one(&files, &history(1))
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
    }

    #[test]
    fn frames_that_were_not_used_stand_above_the_box() {
        let of = |status| {
            let files = Files {
                sources: vec![Source {
                    status,
                    ..Source::default()
                }],
                ..Files::default()
            };
            let text = of_one(&files, &history(1));
            text.split("<section>")
                .next()
                .unwrap_or_default()
                .contains("newer windows may be lost")
        };
        let status = |late, windows, records, samples| Status {
            lost_late: late,
            lost_windows: windows,
            lost_storage_records: records,
            lost_samples: samples,
            ..Status::default()
        };
        let whole = [[12_705, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 7], [0; 4]];
        let found = whole.map(|[late, windows, records, samples]| of(status(late, windows, records, samples)));
        // What a window has lost of its samples, it says itself.
        assert_eq!(found, [true, true, true, false, false]);
    }

    #[test]
    fn a_history_of_nothing_makes_a_page_all_the_same() {
        let text = of_one(&Files::default(), &history(0));
        assert!(text.contains("No recorded window was fitted") && text.ends_with("</html>\n"));
    }

    #[test]
    fn several_actuators_have_an_overview_the_worst_first() {
        let named = |name: &str, state: &str, faults: &[FaultId]| {
            let mut history = history(3);
            history.actuator = name.to_owned();
            let mut health = Health {
                health: state.to_owned(),
                ..Health::default()
            };
            health.set_faults(faults);
            let is_worn = |fault: FaultId| faults.contains(&fault);
            health.set_states(&FaultId::ALL.map(|fault| match is_worn(fault) {
                true => HealthState::named(state),
                false => HealthState::Nominal,
            }));
            history.newest.health = health;
            history
        };
        let well = named("aileron", "nominal", &[]);
        let worn = named("flap", "warning", &[FaultId::Backlash]);
        let text = page(&Files::default(), &[&well, &worn], &view());
        let place = |what: &str| text.find(what).unwrap_or_else(|| panic!("{what}"));
        assert!(place("#actuator-1\">flap") < place("#actuator-0\">aileron"));
        assert!(place("Plan the repair: gear and screw") < place("No action."));
        assert_eq!(text.matches("<article").count(), 2);
    }

    #[test]
    fn a_worn_actuator_with_a_jam_stands_above_a_good_one_with_a_jam() {
        let jammed = |name: &str, state: HealthState| {
            let mut history = history(1);
            history.actuator = name.to_owned();
            history.points[0].estimate = None;
            history.newest.health = Health {
                health: state.name().to_owned(),
                reason: hmd_core::assess::LOCKED.to_owned(),
                ..Health::default()
            };
            let mut states = [HealthState::Nominal; FaultId::COUNT];
            states[0] = state;
            history.newest.health.set_states(&states);
            history
        };
        let (well, worn) = (
            jammed("aileron", HealthState::Nominal),
            jammed("flap", HealthState::Watch),
        );
        let text = page(&Files::default(), &[&well, &worn], &view());
        let place = |what: &str| text.find(what).unwrap_or_else(|| panic!("{what}"));
        assert!(place("#actuator-1\">flap") < place("#actuator-0\">aileron"));
    }
}

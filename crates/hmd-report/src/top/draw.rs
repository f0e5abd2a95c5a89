//! The model on a screen: plain ASCII but for names, and never by colour alone.

use std::ops::Range;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Modifier, Style};

use super::detail::{self, duration};
use super::model::{Condition, Freshness, Model, Row};
use super::state::Event;
use hmd_core::counted::counted;
use hmd_core::health::HealthState;
use hmd_core::record::LogLevel;
use hmd_core::timestamp::minute;

/// Least width that anything can be read at.
pub const WIDTH_MIN: u16 = 60;

/// Least height: head, one actuator and the keys.
pub const HEIGHT_MIN: u16 = 8;

/// Lines of the head: source, actuators, buses and queues, losses.
const HEAD: u16 = 4;

/// Lines of events that the table leaves free.
const EVENTS_MIN: u16 = 2;

/// Whether colours are used; the text says the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colours {
    /// None at all.
    Off,
    /// The first eight, which every terminal has.
    On,
}

/// What is selected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cursor {
    /// Row of the selected actuator.
    pub row: usize,
    /// Show which keys there are; not where there are none.
    pub keys: bool,
}

/// Lines that show everything.
#[must_use]
pub fn full_height(model: &Model<'_>) -> u16 {
    let rows = u16::try_from(model.rows.len().max(1)).unwrap_or(u16::MAX);
    (HEAD + 1 + 1 + detail::LINES + 1)
        .saturating_add(rows)
        .saturating_add(event_lines(model))
}

/// Lines of all events, or of the word that there are none.
fn event_lines(model: &Model<'_>) -> u16 {
    u16::try_from(model.state.events().len().max(1)).unwrap_or(u16::MAX)
}

/// Draws the model; how many actuators the table shows at once.
pub fn draw(model: &Model<'_>, cursor: Cursor, colours: Colours, buffer: &mut Buffer) -> usize {
    let mut page = Page {
        area: buffer.area,
        buffer,
        colours,
        next: 0,
    };
    if page.area.width < WIDTH_MIN || page.area.height < HEIGHT_MIN {
        let text = format!("{WIDTH_MIN}x{HEIGHT_MIN} needed, q ends");
        page.line(&text, Style::new());
        return 1;
    }
    let keys = u16::from(cursor.keys);
    let body = page.area.height - HEAD - 1 - keys;
    // Detail and events go first where there is little room.
    let detail = if body > detail::LINES + 1 { detail::LINES + 1 } else { 0 };
    let left = body - detail;
    let events = (1 + EVENTS_MIN).min(1 + event_lines(model));
    let events = if left > events { events } else { 0 };
    let shown = usize::from(left - events).min(model.rows.len()).max(1);

    // Whole pages, so that the rows stand still while the cursor moves.
    let first = cursor.row / shown * shown;
    let last = (first + shown).min(model.rows.len());
    page.head(model, first..last);
    page.table(model, cursor.row, first..last);
    if detail > 0
        && let Some(row) = model.rows.get(cursor.row)
    {
        page.rule(&format!(" {} ", row.name));
        let below = page.next + detail::LINES;
        for line in detail::lines(row) {
            page.line(&line, Style::new());
        }
        page.next = below;
    }
    if events > 0 {
        page.events(model, keys);
    }
    if cursor.keys {
        page.next = page.area.height - 1;
        page.line(
            "Up/Down select  PgUp/PgDn  w worst first  q quit",
            Style::new().add_modifier(Modifier::DIM),
        );
    }
    shown
}

/// A buffer that is filled from the top.
struct Page<'b> {
    area: Rect,
    buffer: &'b mut Buffer,
    colours: Colours,
    next: u16,
}

impl Page<'_> {
    fn line(&mut self, text: &str, style: Style) {
        self.spans(&[(text, style)]);
    }

    /// One line; what does not fit ends in `~`.
    fn spans(&mut self, spans: &[(&str, Style)]) {
        if self.next >= self.area.height {
            return;
        }
        let (y, width) = (self.area.y + self.next, self.area.width);
        let mut x = self.area.x;
        let end = self.area.x + width;
        for (text, style) in spans {
            let text: String = text.chars().map(|c| if c.is_control() { '?' } else { c }).collect();
            let room = usize::from(end - x);
            let is_cut = ratatui::text::Span::raw(&text).width() > room;
            (x, _) = self.buffer.set_stringn(x, y, &text, room, self.colour(*style));
            if is_cut {
                self.buffer.set_stringn(end - 1, y, "~", 1, self.colour(*style));
                break;
            }
        }
        self.next += 1;
    }

    fn colour(&self, style: Style) -> Style {
        match self.colours {
            Colours::On => style,
            Colours::Off => Style {
                fg: None,
                bg: None,
                ..style
            },
        }
    }

    fn rule(&mut self, title: &str) {
        let rest = usize::from(self.area.width).saturating_sub(2 + title.chars().count());
        self.line(&format!("--{title}{}", "-".repeat(rest)), Style::new());
    }

    fn head(&mut self, model: &Model<'_>, rows: Range<usize>) {
        let (text, style) = condition(model);
        self.spans(&[
            ("hmd top  ", bold()),
            (&text, style),
            ("  ", Style::new()),
            (model.place, Style::new()),
        ]);
        self.actuators(model, rows);
        match model.state.status() {
            Some((_, status)) => {
                let style = if status
                    .interfaces
                    .iter()
                    .any(|on| !on.link.is_empty() && on.link != "up")
                {
                    alarm()
                } else {
                    Style::new()
                };
                self.line(&super::process::buses(status), style);
                let style = if status.data_lost() { caution() } else { Style::new() };
                let damaged = model.state.damaged;
                self.line(&super::process::losses(status, damaged), style);
            }
            None => {
                self.line(
                    "buses    not reported yet: a record of the counters comes every ten seconds",
                    Style::new(),
                );
                self.line(
                    &format!(
                        "lost     not reported yet{}",
                        super::process::damage(model.state.damaged)
                    ),
                    Style::new(),
                );
            }
        }
    }

    fn actuators(&mut self, model: &Model<'_>, rows: Range<usize>) {
        let counts: Vec<(String, Style)> = model
            .counts
            .iter()
            .map(|(health, count)| (format!("  {count} {health}"), health_style(*health)))
            .collect();
        let total = match model.rows.len() {
            1 => "1 actuator".to_owned(),
            several if rows.len() < several => format!("{several} actuators, {}-{} shown", rows.start + 1, rows.end),
            several => format!("{several} actuators"),
        };
        let stale = format!("  {} STALE", model.stale);
        let refused = format!(
            "  {} of further ones left out",
            counted(model.state.refused, "record", "records")
        );
        let mut spans = vec![(total.as_str(), Style::new())];
        spans.extend(counts.iter().map(|(text, style)| (text.as_str(), *style)));
        if model.stale > 0 {
            spans.push((&stale, alarm()));
        }
        if model.state.refused > 0 {
            spans.push((&refused, alarm()));
        }
        self.spans(&spans);
    }

    fn table(&mut self, model: &Model<'_>, selected: usize, rows: Range<usize>) {
        let head = format!(
            "  {:<10} {:<12} {:<9} {:<18} {:<18} {:>6}",
            "ACTUATOR", "DATA", "HEALTH", "LEFT, h (10..90 %)", "LARGEST DAMAGE", "AGO"
        );
        self.line(&head, bold());
        if model.rows.is_empty() {
            self.line("  no actuator reported yet", Style::new());
        }
        for (n, row) in model.rows.iter().enumerate().skip(rows.start).take(rows.len()) {
            self.row(row, n == selected);
        }
    }

    fn row(&mut self, row: &Row<'_>, is_selected: bool) {
        let (data, data_style) = match row.freshness {
            Freshness::NotReported => ("-".to_owned(), Style::new()),
            Freshness::Fresh => ("fresh".to_owned(), Style::new()),
            Freshness::Stale(s) => (format!("STALE {}", duration(s)), alarm()),
        };
        let marked = if row.persistence > 0 { "+" } else { "" };
        let health = format!("{}{marked}", row.health.name());
        let ago = row.window_age_s.map_or_else(|| "-".to_owned(), duration);
        let name = format!("{} {:<10} ", if is_selected { ">" } else { " " }, fit(row.name, 10));
        let rest = format!(" {:<18} {:<18} {ago:>6}", left(row), worst(row));
        let name_style = if is_selected { bold() } else { Style::new() };
        self.spans(&[
            (&name, name_style),
            (&format!("{data:<12} "), data_style),
            (&format!("{health:<9}"), health_style(row.health)),
            (&rest, Style::new()),
        ]);
    }

    fn events(&mut self, model: &Model<'_>, keys: u16) {
        let room = usize::from((self.area.height - keys).saturating_sub(self.next + 1));
        self.rule(" last events, UTC ");
        let all = model.state.events();
        let older = all.len().saturating_sub(room);
        if all.len() == 0 {
            self.line("none", Style::new());
        }
        for event in all.skip(older) {
            self.event(event);
        }
    }

    fn event(&mut self, event: &Event) {
        let (mark, style) = match event.level {
            LogLevel::Fatal | LogLevel::Error => ("ERROR ", alarm()),
            LogLevel::Warning => ("WARN  ", caution()),
            LogLevel::Info | LogLevel::Debug | LogLevel::Unknown => ("", Style::new()),
        };
        let seconds = event.at_ns / 1_000_000_000 % 60;
        let at = format!("{}:{seconds:02} ", minute(event.at_ns));
        self.spans(&[(&at, Style::new()), (mark, style), (&event.message, style)]);
    }
}

/// State of the source.
fn condition(model: &Model<'_>) -> (String, Style) {
    match model.condition {
        Condition::Reading(share) => (format!("READING {:.0} %", 100.0 * share), bold()),
        Condition::Live(s) => (format!("LIVE, newest record written {} ago", duration(s)), bold()),
        Condition::Silent(s) => (format!("SILENT: nothing written for {}", duration(s)), alarm()),
        Condition::Ended(s) => (format!("ENDED {} ago", duration(s)), alarm()),
        Condition::Recorded => (
            format!("RECORDED until {} UTC", minute(model.state.newest_ns())),
            bold(),
        ),
    }
}

fn left(row: &Row<'_>) -> String {
    let rul = row.known.and_then(|known| known.rul.as_ref());
    match rul.and_then(|rul| Some((rul.rul_p10_h?, rul.rul_p50_h?, rul.rul_p90_h?))) {
        Some((p10, p50, p90)) => fit(&format!("{p50:.0} ({p10:.0}..{p90:.0})"), 18),
        None => "-".to_owned(),
    }
}

/// `friction      59 %`.
fn worst(row: &Row<'_>) -> String {
    let Some((fault, damage)) = row.worst else {
        return "-".to_owned();
    };
    format!("{:<12} {:>3.0} %", fault, 100.0 * damage.clamp(0.0, 1.0))
}

/// A text of at most so many characters; one that is cut ends in `~`.
fn fit(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    text.chars().take(most - 1).chain(['~']).collect()
}

fn bold() -> Style {
    Style::new().add_modifier(Modifier::BOLD)
}

/// What must be seen: reversed, so that it shows without colours too.
fn alarm() -> Style {
    Style::new().fg(Color::Red).add_modifier(Modifier::REVERSED)
}

/// What is worth a look; a count of losses stays until the next start.
fn caution() -> Style {
    Style::new().fg(Color::Yellow).add_modifier(Modifier::BOLD)
}

fn health_style(health: HealthState) -> Style {
    match health {
        HealthState::Unknown => Style::new(),
        HealthState::Nominal => Style::new().fg(Color::Green),
        HealthState::Watch => Style::new().fg(Color::Cyan).add_modifier(Modifier::BOLD),
        HealthState::Warning => caution(),
        HealthState::Critical => alarm(),
    }
}

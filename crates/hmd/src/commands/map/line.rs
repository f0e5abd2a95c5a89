//! One signal as a line of TOML.

use hmd_core::dbc::Role;
use hmd_core::log_map::{Doubt, Quantity};
use hmd_ingest::file::SurveyedSignal;

/// The line of a quantity in the section `[map]`.
pub(super) fn line(quantity: Quantity, signal: &SurveyedSignal) -> String {
    let name = quoted(&signal.name);
    if quantity == Quantity::MODE && !(signal.range.is_some() && has_known_modes(signal)) {
        return mode_line(&name, &signal.texts);
    }
    let needs_unit = !matches!(quantity, Quantity::Counter | Quantity::MODE);
    let wraps = wraps_after(quantity, signal).map(|turn| turn.to_string());
    let wraps = wraps.or_else(|| (signal.doubt == Doubt::Electrical).then(|| "…".to_owned()));
    let scale = if signal.doubt.needs_scale() {
        ", scale = …"
    } else {
        ""
    };
    let unit = match (&signal.guessed_unit, &signal.unit) {
        (None, None) if needs_unit => ", unit = \"…\"".to_owned(),
        (None, Some(unit)) if wraps.is_some() || signal.doubt.needs_scale() => format!(", unit = {}", quoted(unit)),
        (None, _) => String::new(),
        (Some(unit), _) => format!(", unit = {}", quoted(unit)),
    };
    let wraps = wraps.map_or(String::new(), |turn| format!(", wraps_after = {turn}"));
    if unit.is_empty() && wraps.is_empty() {
        return format!("{} = {name}", quantity.key());
    }
    format!("{} = {{ signal = {name}{unit}{scale}{wraps} }}", quantity.key())
}

/// Whether the values of a mode tell which is position mode: names, or the numbers that need no key.
pub(super) fn has_known_modes(signal: &SurveyedSignal) -> bool {
    match signal.range {
        Some([least, largest]) => least >= 0.0 && largest <= 2.0,
        None => text_of(POSITION, &signal.texts).is_some(),
    }
}

/// Beginnings of the names of modes.
const POSITION: &[&str] = &["pos", "angle"];
const SPEED: &[&str] = &["speed", "spd", "vel"];

fn text_of<'a>(starts: &[&str], texts: &'a [String]) -> Option<&'a String> {
    let is_like = |text: &&String| starts.iter().any(|start| text.to_ascii_lowercase().starts_with(start));
    texts.iter().find(is_like)
}

/// A mode by its values, texts or numbers that nobody knows.
fn mode_line(name: &str, texts: &[String]) -> String {
    let value = |text: &str| {
        if texts.is_empty() {
            "…".to_owned()
        } else {
            quoted(text)
        }
    };
    let position = value(text_of(POSITION, texts).map_or("…", String::as_str));
    // A mode that this log does not have needs no text.
    let speed = text_of(SPEED, texts).map_or(String::new(), |speed| format!(", speed = {}", quoted(speed)));
    format!(
        "{} = {{ signal = {name}, position = {position}{speed} }}",
        Quantity::MODE.key()
    )
}

/// The turn after which an angle begins again, if its range is nearly one, or if it jumps by most of its range.
pub(super) fn wraps_after(quantity: Quantity, signal: &SurveyedSignal) -> Option<f64> {
    /// Share of a turn that a wrapping angle passes in nearly every log.
    const NEARLY: f64 = 0.99;
    /// The same of one that is seen to jump; a jump's share of its range.
    const WITH_A_JUMP: f64 = 0.9;
    if !matches!(quantity, Quantity::Of(Role::MotorPosition | Role::OutputPosition)) {
        return None;
    }
    let [least, largest] = signal.range?;
    let range = largest - least;
    let jumps = range > 0.0 && signal.jump >= WITH_A_JUMP * range;
    let turn = match signal.unit_or_guess()? {
        "deg" | "°" => 360.0,
        "rad" => core::f64::consts::TAU,
        "rev" => 1.0,
        // Of a sensor whose resolution nobody said: turns have powers of two.
        "counts" if jumps => range.log2().ceil().exp2(),
        _ => return None,
    };
    let nearly = if jumps { WITH_A_JUMP } else { NEARLY };
    (nearly * turn..=turn).contains(&range).then_some(turn)
}

/// A text as TOML has it.
pub(super) fn quoted(text: &str) -> String {
    format!("\"{}\"", plain(text).replace('\\', "\\\\").replace('"', "\\\""))
}

/// A text without what breaks a line.
pub(super) fn plain(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

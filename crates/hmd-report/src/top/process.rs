//! Status lines of the recording process.

use hmd_core::counted::counted;
use hmd_core::record::Status;

/// Interfaces that are not OK, by name; how many are; queues; storage.
pub(super) fn buses(status: &Status) -> String {
    let state = |n: usize| {
        let interface = &status.interfaces[n];
        (interface.link.as_str(), interface.bus_state.as_str())
    };
    let is_ok = |n: usize| matches!(state(n), ("up" | "", "error-active" | ""));
    let interfaces = status.interfaces.iter().map(|on| &on.interface).enumerate();
    let (ok, others): (Vec<_>, Vec<_>) = interfaces.partition(|(n, _)| is_ok(*n));
    let mut parts: Vec<String> = others
        .iter()
        .map(|(n, name)| match state(*n) {
            ("up" | "", bus) => format!("{name} {bus}"),
            (link, _) => format!("{name} {}", link.to_uppercase()),
        })
        .collect();
    match ok.as_slice() {
        [] => {}
        [(_, only)] => parts.push(format!("{only} OK")),
        several => parts.push(format!("{} OK", several.len())),
    }
    if parts.is_empty() {
        parts.push("none reported".to_owned());
    }
    let mut text = format!("buses    {}", parts.join(", "));
    // A replay has none.
    if !status.actuators.is_empty() {
        text += &format!(
            "; queues {}, {}",
            counted(status.queued_inputs, "input", "inputs"),
            counted(status.queued_windows, "window", "windows")
        );
    }
    if !status.storage.is_empty() {
        text += &format!(
            "; storage {}, {} free",
            status.storage,
            bytes(status.storage_free_bytes)
        );
    }
    text
}

/// What came in, and what was lost by cause.
pub(super) fn losses(status: &Status, damaged: u64) -> String {
    let lost: Vec<String> = status
        .losses()
        .iter()
        .filter(|(_, count)| *count > 0)
        .map(|(cause, count)| format!("{count} {cause}"))
        .collect();
    let lost = if lost.is_empty() {
        "nothing".to_owned()
    } else {
        lost.join(", ")
    };
    let windows = [
        (status.windows_ok, "ok"),
        (status.windows_degraded, "degraded"),
        (status.windows_invalid, "invalid"),
        (status.windows_unmodelled, "unmodelled"),
    ];
    let windows: Vec<String> = windows
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, status)| format!("{count} {status}"))
        .collect();
    let windows = if windows.is_empty() {
        "0".to_owned()
    } else {
        windows.join(", ")
    };
    format!(
        "lost     {lost}; frames {}, windows {windows}{}",
        status.frames_received,
        damage(damaged)
    )
}

/// Places in the files that could not be read; nothing where there are none.
pub(super) fn damage(damaged: u64) -> String {
    if damaged > 0 {
        format!("; {} in the file", counted(damaged, "damaged place", "damaged places"))
    } else {
        String::new()
    }
}

fn bytes(count: u64) -> String {
    match count as f64 {
        b if b < 1e6 => format!("{:.0} kB", b / 1e3),
        b if b < 1e9 => format!("{:.0} MB", b / 1e6),
        b => format!("{:.0} GB", b / 1e9),
    }
}

//! A progress bar with the time left, on a terminal only.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A bar over bytes of input.
pub(super) fn over_bytes(total: u64) -> ProgressBar {
    styled(total, "{bar:40} {bytes}/{total_bytes}, {eta} left")
}

/// A bar over pieces of work.
pub(super) fn over_pieces(total: u64) -> ProgressBar {
    styled(total, "{bar:40} {pos}/{len}, {eta} left")
}

fn styled(total: u64, template: &str) -> ProgressBar {
    // stderr hides the bar by itself where it is no terminal.
    let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr());
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar
}

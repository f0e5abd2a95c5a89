//! OpenMetrics as the older text format of Prometheus (0.0.4), the only one that the textfile collector of `node_exporter` reads.
//!
//! The two differ in the family of a counter: OpenMetrics names it without the `_total` of its samples, the text format as its samples,
//! else these have no type. The closing `# EOF` is a comment there, and left out.

use std::collections::BTreeSet;

/// The same metrics in the text format.
#[must_use]
pub fn in_text_format(open_metrics: &str) -> String {
    let families = open_metrics.lines().filter_map(|line| line.strip_prefix("# TYPE "));
    let counters: BTreeSet<&str> = families.filter_map(|family| family.strip_suffix(" counter")).collect();
    let mut out = String::with_capacity(open_metrics.len() + 1024);
    for line in open_metrics.lines().filter(|line| *line != "# EOF") {
        let parts = line.strip_prefix("# ").map(|comment| comment.splitn(3, ' '));
        let named = parts.and_then(|mut parts| Some((parts.next()?, parts.next()?, parts.next()?)));
        match named.filter(|(_, family, _)| counters.contains(family)) {
            Some((keyword, family, rest)) => {
                for text in ["# ", keyword, " ", family, "_total ", rest] {
                    out.push_str(text);
                }
            }
            None => out.push_str(line),
        }
        out.push('\n');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_families_of_counters_have_another_name() {
        let open = "# HELP hmd_frames Frames received.\n# TYPE hmd_frames counter\nhmd_frames_total{outcome=\"error\"} 7\n\
                    # HELP hmd_frames_waiting Frames.\n# TYPE hmd_frames_waiting gauge\nhmd_frames_waiting 1\n# EOF\n";
        let text = "# HELP hmd_frames_total Frames received.\n# TYPE hmd_frames_total counter\nhmd_frames_total{outcome=\"error\"} 7\n\
                    # HELP hmd_frames_waiting Frames.\n# TYPE hmd_frames_waiting gauge\nhmd_frames_waiting 1\n";
        assert_eq!(in_text_format(open), text);
        assert_eq!(in_text_format(""), "");
    }
}

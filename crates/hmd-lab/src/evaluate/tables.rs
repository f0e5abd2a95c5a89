//! Results of the suites as Markdown tables, as `hmd evaluate` prints them.

use super::{Case, DetectionReport, NoiseReport, PaperReport, ProfilesReport, RandomReport, RulReport, Scores};
use ema_models::FaultId;

/// Mean and largest error of each group of cases.
#[must_use]
pub fn paper_table(report: &PaperReport) -> String {
    let mut text = "| case | mean rss, % | max rss, % | mean eq. 15, % |\n|---|---|---|---|\n".to_owned();
    let mut row = |name: &str, mean: f64, max: f64, eq15: f64| {
        text += &format!("| {name} | {mean:.2} | {max:.2} | {eq15:.2} |\n");
    };
    for group in report.cases.chunk_by(|a, b| a.name == b.name) {
        let n = group.len() as f64;
        let mean = |f: fn(&Case) -> f64| group.iter().map(f).sum::<f64>() / n;
        let max = group.iter().map(|c| c.rss_pct).fold(0.0, f64::max);
        row(&group[0].name, mean(|c| c.rss_pct), max, mean(|c| c.eq15_pct));
    }
    row(
        "**all single faults**",
        report.single.mean_rss_pct,
        report.single.max_rss_pct,
        report.single.mean_eq15_pct,
    );
    row(
        "**multiple faults**",
        report.multi.mean_rss_pct,
        report.multi.max_rss_pct,
        report.multi.mean_eq15_pct,
    );
    text.truncate(text.trim_end().len());
    text
}

/// Median and 95th percentile of the errors of all windows.
#[must_use]
pub fn random_table(report: &RandomReport) -> String {
    format!(
        "| windows | median rss, % | p95 rss, % | median eq. 15, % |\n|---|---|---|---|\n| {} | {:.2} | {:.2} | {:.2} |",
        report.cases.len(),
        report.median_rss_pct,
        report.p95_rss_pct,
        report.median_eq15_pct
    )
}

/// Errors, coverage and ratio to the Cramér–Rao bound at each sample rate.
#[must_use]
pub fn noise_table(report: &NoiseReport) -> String {
    let mut text =
        "| rate, Hz | windows | median rss, % | p95 rss, % | 95 % interval covers, % | error over Cramér–Rao bound, \
                    matched data |\n|---|---|---|---|---|---|"
            .to_owned();
    for rate in &report.rates {
        text += &format!(
            "\n| {:.0} | {} | {:.2} | {:.2} | {:.1} | {:.2} |",
            rate.sample_rate_hz,
            rate.cases.len(),
            rate.median_rss_pct,
            rate.p95_rss_pct,
            100.0 * rate.coverage_95,
            rate.crlb_ratio
        );
    }
    text
}

/// Detection and isolation rate of each fault, and the rate of false alarms.
#[must_use]
pub fn detection_table(report: &DetectionReport) -> String {
    let mut text = "| windows | detected, % | exactly named, % |\n|---|---|---|".to_owned();
    for fault in &report.detection_rate_by_fault {
        text += &format!(
            "\n| {} ({}) | {:.2} | {:.2} |",
            fault.fault,
            fault.windows,
            100.0 * fault.detection_rate,
            100.0 * fault.isolation_rate
        );
    }
    text += &format!(
        "\n| **all faulty ones** | {:.2} | {:.2} |\n\nFalse alarms in healthy windows: {:.3} %.",
        100.0 * report.detection_rate,
        100.0 * report.isolation_rate,
        100.0 * report.false_alarm_rate
    );
    text
}

/// Errors, coverage and observable faults of each kind of command or condition.
#[must_use]
pub fn profiles_table(report: &ProfilesReport) -> String {
    let mut text = "| windows | noise | rate, Hz | median rss, % | p95 rss, % | covers, % | covers healthy, % | shows k1 | k2 | \
                    k3…k5 | k6 | k8, % | false faults | unmodelled | ambiguous | max cost |\n|---|---|---|---|---|---|---|---|---|---|---|---\
                    |---|---|---|---|"
        .to_owned();
    for row in &report.rows {
        let shown = row.observable.map(|share| 100.0 * share);
        text += &format!(
            "\n| {} | {} | {:.0} | {:.2} | {:.2} | {:.1} | {:.1} | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} | {} | {} | {} | {:.1} |",
            row.name,
            if row.noise { "yes" } else { "no" },
            row.sample_rate_hz,
            row.median_rss_pct,
            row.p95_rss_pct,
            100.0 * row.coverage_95,
            100.0 * row.healthy_coverage_95,
            shown[0],
            shown[1],
            (shown[2] + shown[3] + shown[4]) / 3.0,
            shown[5],
            shown[7],
            row.false_faults,
            row.unmodelled,
            row.ambiguous,
            row.max_cost
        );
    }
    text
}

/// Scores of the monitor and of the oracle, `ours / oracle`.
#[must_use]
pub fn rul_table(report: &RulReport) -> String {
    let mut text =
        "| histories | α-λ passed, % | horizon, % of life | cumulative relative accuracy | 80 % interval covers, % \
                    | convergence |\n|---|---|---|---|---|---|"
            .to_owned();
    let mut row = |name: &str, histories: usize, ours: &Scores, oracle: &Scores| {
        let percent = |of: fn(&Scores) -> f64| format!("{:.1} / {:.1}", 100.0 * of(ours), 100.0 * of(oracle));
        let share = |of: fn(&Scores) -> f64| format!("{:.3} / {:.3}", of(ours), of(oracle));
        text += &format!(
            "\n| {name} ({histories}) | {} | {} | {} | {} | {} |",
            percent(|s| s.alpha_lambda_pass_rate),
            percent(|s| s.prognostic_horizon_fraction),
            share(|s| s.cra),
            percent(|s| s.coverage_80),
            share(|s| s.convergence),
        );
    };
    for group in &report.groups {
        row(&group.name, group.histories, &group.scores, &group.oracle);
    }
    let all = report.histories_per_fault as usize * FaultId::COUNT;
    row("**all**", all, &report.scores, &report.oracle);
    text + "\n\nEach cell: this monitor / an oracle that knows the true law and how its parameters are distributed."
}

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

/// The cases of the paper's Tables II and III beside what it prints, and what a window took; `seconds` of processor time are those of all
/// windows.
#[must_use]
pub fn beside_the_paper(report: &PaperReport, seconds: f64) -> String {
    let mut text = "| | rss, % | eq. 15, % | the paper's column \"%err\" | rss of its rows | eq. 15 of its rows |\n\
                    |---|---|---|---|---|---|"
        .to_owned();
    for (table, case, [printed, rss, eq15]) in PRINTED {
        let cases: Vec<&Case> = report.cases.iter().filter(|found| found.name == case).collect();
        let mean = |f: fn(&Case) -> f64| cases.iter().map(|case| f(case)).sum::<f64>() / cases.len().max(1) as f64;
        text += &format!(
            "\n| {table} | {:.2} | {:.2} | {printed} | {rss} | {eq15} |",
            mean(|found| found.rss_pct),
            mean(|found| found.eq15_pct)
        );
    }
    let windows = report.cases.len().max(1) as f64;
    let evaluations = report.cases.iter().map(|case| case.evaluations).sum::<u64>() as f64 / windows;
    let each = seconds / windows;
    text + &format!(
        "\n\nA window took {evaluations:.0} evaluations and {each:.1} s of one core; the paper reports about 15 minutes, {:.0} \
         times as long, and no count.",
        PAPER_SECONDS / each
    )
}

/// The paper's tables: case, mean of the column as printed, and of its rows by either definition (phase as an angle), %.
const PRINTED: [(&str, &str, [&str; 3]); 2] = [
    ("Table II, medium friction", "friction medium", ["2.27", "2.68", "0.95"]),
    ("Table III, multiple faults", "table III", ["5.21", "5.36", "1.89"]),
];

/// Time of one identification in the paper's section 7, s.
const PAPER_SECONDS: f64 = 15.0 * 60.0;

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
                    | early, % | convergence |\n|---|---|---|---|---|---|---|"
            .to_owned();
    let mut row = |name: &str, histories: usize, ours: &Scores, oracle: &Scores| {
        let percent = |of: fn(&Scores) -> f64| format!("{:.1} / {:.1}", 100.0 * of(ours), 100.0 * of(oracle));
        let share = |of: fn(&Scores) -> f64| format!("{:.3} / {:.3}", of(ours), of(oracle));
        text += &format!(
            "\n| {name} ({histories}) | {} | {} | {} | {} | {} | {} |",
            percent(|s| s.alpha_lambda_pass_rate),
            percent(|s| s.prognostic_horizon_fraction),
            share(|s| s.cra),
            percent(|s| s.coverage_80),
            percent(|s| s.coverage_80_early),
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

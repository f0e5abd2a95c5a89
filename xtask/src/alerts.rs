//! Our alert rules and dashboard under Prometheus: accepted, tested, fired and answered by a worn actuator that `hmd run` watches.

use crate::debian;
use crate::programs::Programs;
use crate::shell::{program, root, run, target_dir};

/// Brings the checker of rules, too.
const PACKAGES: [(&str, &str); 1] = [("prometheus", "/usr/bin/promtool")];

/// Checks rules, metrics and the alert.
pub(crate) fn check() -> anyhow::Result<()> {
    debian::install(&PACKAGES)?;
    let rules = root().join("dist/prometheus");
    run(program("promtool", ["check", "rules"]).arg(rules.join("hmd.rules.yml")))?;
    run(program("promtool", ["test", "rules"]).arg(rules.join("hmd.test.yml")))?;
    let dashboard = root().join("dist/grafana/hmd.json");
    let programs = Programs::build()?;
    let folder = target_dir()?.join("alerts");
    run(program("python3", ["fixtures/check_alerts.py"])
        .args([&programs.hmd(), &programs.firmware_sim(), &rules, &dashboard, &folder])
        .current_dir(root()))
}

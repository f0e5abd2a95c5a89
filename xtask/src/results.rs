//! Numbers in documents: each stands under the command that makes it, and this runs them all again.
//!
//! A line `<!-- $ hmd evaluate paper -->` says that the text up to `<!-- end -->` is what the command prints, on stdout
//! and stderr together. Where the text is fenced as code, it stays fenced. Commands read the files that stand in the document: `toml`
//! below a line `<!-- NAME.toml -->`.

use std::path::Path;

use anyhow::{Context, bail};

use crate::shell::{cargo, root, run, target_dir};

/// Documents with such lines.
const DOCUMENTS: [&str; 8] = [
    "README.md",
    // The long tables of the pages.
    "fixtures/results/bench.md",
    "fixtures/results/paper.md",
    "fixtures/results/servo28.md",
    "fixtures/results/forecasts.md",
    "fixtures/results/robust.md",
    "fixtures/results/sensors.md",
    "docs/viewers.md",
];

/// Makes `hmd-demo.mcap`, which documents show.
const DEMO: &str = "demo";

const BEGIN: &str = "<!-- $ hmd ";
const END: &str = "<!-- end -->";
const FILE: (&str, &str) = ("<!-- ", ".toml -->");

/// Runs every command and puts its output in place.
pub(crate) fn update() -> anyhow::Result<()> {
    run(cargo(["build", "--release", "--package", "hmd"]))?;
    let hmd = target_dir()?.join("release").join("hmd");
    let scratch = target_dir()?.join("results");
    std::fs::create_dir_all(&scratch).context("target/results")?;
    printed(DEMO, &hmd, &scratch)?;
    for document in DOCUMENTS {
        let path = root().join(document);
        let text = std::fs::read_to_string(&path).with_context(|| document.to_owned())?;
        let updated = updated(&text, &hmd, &scratch).with_context(|| document.to_owned())?;
        std::fs::write(&path, updated).with_context(|| document.to_owned())?;
    }
    run(cargo([
        "run",
        "--release",
        "--package",
        "hmd-tests",
        "--example",
        "figures",
    ]))
}

fn updated(text: &str, hmd: &Path, scratch: &Path) -> anyhow::Result<String> {
    let mut out = String::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        out += line;
        out.push('\n');
        let name = line.strip_prefix(FILE.0).and_then(|rest| rest.strip_suffix(FILE.1));
        if let Some(name) = name.filter(|name| !name.contains(' ')) {
            let block: Vec<&str> = lines.by_ref().take_while(|line| *line != "```").collect();
            block.iter().for_each(|line| out += &format!("{line}\n"));
            out += "```\n";
            let path = scratch.join(name).with_extension("toml");
            let content: Vec<&str> = block.into_iter().skip(1).collect();
            std::fs::write(&path, content.join("\n")).with_context(|| path.display().to_string())?;
            continue;
        }
        let Some(command) = line.strip_prefix(BEGIN).and_then(|rest| rest.strip_suffix(" -->")) else {
            continue;
        };
        let old: Vec<&str> = lines.by_ref().take_while(|line| *line != END).collect();
        let fence = old.first().filter(|first| first.starts_with("```"));
        let printed = printed(command, hmd, scratch)?;
        if let Some(fence) = fence {
            out += &format!("{fence}\n$ hmd {command}\n{printed}```\n");
        } else {
            out += &printed;
        }
        out += &format!("{END}\n");
    }
    Ok(out)
}

fn printed(command: &str, hmd: &Path, scratch: &Path) -> anyhow::Result<String> {
    eprintln!("$ hmd {command}");
    let output = std::process::Command::new(hmd)
        .args(command.split_whitespace())
        .current_dir(scratch)
        .output()
        .with_context(|| command.to_owned())?;
    if !output.status.success() {
        bail!(
            "hmd {command}: {}: {}",
            output.status,
            String::from_utf8_lossy(&output.stderr)
        );
    }
    let mut text = String::from_utf8(output.stdout)?;
    text += &String::from_utf8(output.stderr)?;
    let lines: Vec<&str> = text.lines().map(str::trim_end).collect();
    Ok(lines.iter().map(|line| format!("{line}\n")).collect())
}

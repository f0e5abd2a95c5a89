//! Identification on an emulated Cortex-M7: the bits that the host finds, and what it costs, written into `docs/target.md`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context, ensure};

use crate::debian;
use crate::no_std::TARGET;
use crate::programs::Programs;
use crate::shell::{cargo, program, root, run, target_dir};

/// The emulator.
pub(crate) const PACKAGES: [(&str, &str); 1] = [("qemu-system-arm", "/usr/bin/qemu-system-arm")];

/// For the processor, whose unit computes single and double precision.
pub(crate) const FLAGS: &str = "-Clink-arg=-Tlink.x -Ctarget-cpu=cortex-m7";

const DOCUMENT: &str = "docs/target.md";
const BEGIN: &str = "<!-- $ cargo xtask target -->\n";
const END: &str = "<!-- end -->\n";

/// Longest run of the emulator, s.
const LIMIT_S: &str = "900";

/// Clock of the processor, Hz; an instruction counts as one cycle.
const CLOCK_HZ: f64 = 480e6;

/// Most instructions of a monitor step in single precision.
const MOST_PER_STEP: f64 = 300.0;

/// Most instructions of a monitor step in double precision, in which identification runs it.
const MOST_PER_STEP_DOUBLE: f64 = 420.0;

/// Most RAM, statics and stack together.
const MOST_RAM_KIB: f64 = 48.0;

/// Logs of `fixtures/logs` that a short run identifies beside the worn actuator: no fault, many, and the slow sample rate.
const SOME_LOGS: [&str; 3] = ["healthy.mcap", "random-05.mcap", "table-iii-400hz.mcap"];

/// Builds, runs, compares, and writes the table; on a few windows, or on those of all golden logs.
pub(crate) fn check(all: bool) -> anyhow::Result<()> {
    debian::install(&PACKAGES)?;
    run(program("rustup", ["target", "add", TARGET]))?;
    let cases = target_dir()?.join("target_cases.rs");
    let logs: &[&str] = if all { &["all"] } else { &SOME_LOGS };
    let here = numbers(program(Programs::build()?.example("target_cases"), [&cases]).args(logs))?;
    let there = on_target(&cases)?;
    let windows = same_estimates(&here, &there)?;
    let figures = Figures::of(&there)?;
    let table = table(&here, &figures, windows)?;
    eprint!("{table}");
    let path = root().join(DOCUMENT);
    let text = std::fs::read_to_string(&path).context(DOCUMENT)?;
    std::fs::write(&path, with_table(&text, &table)?).context(DOCUMENT)?;
    if !all {
        none_grew(&text, &table)?;
    }
    ensure!(
        figures.per_step <= MOST_PER_STEP,
        "expected at most {MOST_PER_STEP} instructions per step in single precision, found {:.1}",
        figures.per_step
    );
    ensure!(
        figures.per_step_double <= MOST_PER_STEP_DOUBLE,
        "expected at most {MOST_PER_STEP_DOUBLE} instructions per step in double precision, found {:.1}",
        figures.per_step_double
    );
    ensure!(
        figures.ram_kib() <= MOST_RAM_KIB,
        "expected at most {MOST_RAM_KIB} KiB of RAM, found {:.1}",
        figures.ram_kib()
    );
    Ok(())
}

/// `name value` lines that a program prints.
type Numbers = BTreeMap<String, String>;

fn numbers(command: &mut std::process::Command) -> anyhow::Result<Numbers> {
    let name = command.get_program().to_string_lossy().into_owned();
    eprintln!("$ {name} …");
    let output = command.output().with_context(|| name.clone())?;
    let mut text = String::from_utf8_lossy(&output.stdout).into_owned();
    text += &String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{name}: {}: {text}", output.status);
    let pairs = text.lines().filter_map(|line| line.split_once(' '));
    Ok(pairs.map(|(name, value)| (name.to_owned(), value.to_owned())).collect())
}

/// Builds the image with the windows in it and runs it.
fn on_target(cases: &Path) -> anyhow::Result<Numbers> {
    let build = ["build", "--quiet", "--profile", "image", "--package", "firmware_image"];
    run(cargo(build)
        .args(["--bin", "identify", "--features", "image", "--target", TARGET])
        .env("HMD_TARGET_CASES", cases)
        .env("RUSTFLAGS", FLAGS))?;
    let image = target_dir()?.join(TARGET).join("image/identify");
    numbers(
        program(
            "timeout",
            [LIMIT_S, "qemu-system-arm", "-M", "mps2-an500", "-cpu", "cortex-m7"],
        )
        .args(["-nographic", "-monitor", "none", "-serial", "null", "-semihosting"])
        // Each instruction lasts one nanosecond.
        .args(["-icount", "shift=0", "-kernel"])
        .arg(image),
    )
}

/// Every number of every estimate is the host's, bit for bit; the number of windows. Only a sigma may be off in its last
/// bits, because the host takes its `hypot` from the system.
fn same_estimates(here: &Numbers, there: &Numbers) -> anyhow::Result<usize> {
    let mut windows = BTreeSet::new();
    for (name, expected) in here {
        let Some((window, number)) = name.split_once('/') else {
            continue;
        };
        windows.insert(window);
        let found = there.get(name).with_context(|| format!("expected a line {name}"))?;
        let same = found == expected || number.starts_with("sigma") && nearly_same(found, expected);
        ensure!(same, "{name}: expected the host's {expected}, found {found}");
    }
    let expected = NUMBERS * windows.len() + RELATIONS_NUMBERS;
    let compared = here.keys().filter(|name| name.contains('/')).count();
    ensure!(
        compared == expected,
        "expected {expected} numbers to compare, found {compared}"
    );
    Ok(windows.len())
}

/// Numbers of one estimate.
const NUMBERS: usize = 36;

/// Numbers of the estimate by relations, of one window.
const RELATIONS_NUMBERS: usize = 20;

/// Whether two doubles, given by their bits, are at most four units in the last place apart.
fn nearly_same(a: &str, b: &str) -> bool {
    let bits = |text| u64::from_str_radix(text, 16).ok();
    bits(a).zip(bits(b)).is_some_and(|(a, b)| a.abs_diff(b) <= 4)
}

/// What one build costs.
struct Figures {
    per_step: f64,
    per_step_double: f64,
    per_step_in_full: f64,
    prepare: f64,
    linearisation: f64,
    identify: f64,
    /// Mean and most over all windows, with making them ready.
    whole_each: [f64; 2],
    relations: f64,
    window_bytes: f64,
    ram_bytes: f64,
    flash_bytes: f64,
}

impl Figures {
    fn of(numbers: &Numbers) -> anyhow::Result<Self> {
        let expected = number(numbers, "loop_expected")?;
        let counted = number(numbers, "loop_counted")?;
        ensure!(
            (counted - expected).abs() <= 200.0,
            "a loop of {expected} instructions was counted as {counted}"
        );
        let steps = number(numbers, "monitor_steps")?;
        let linearisation = number(numbers, "linearisation_instructions")?;
        let windows = numbers
            .keys()
            .filter_map(|name| name.strip_suffix("/identify_instructions"));
        let whole = |window: &str| {
            let of = |part: &str| number(numbers, &format!("{window}/{part}_instructions"));
            anyhow::Ok(of("prepare")? + of("identify")?)
        };
        let each = windows.map(whole).collect::<anyhow::Result<Vec<_>>>()?;
        let mean = each.iter().sum::<f64>() / each.len().max(1) as f64;
        Ok(Self {
            per_step: number(numbers, "single_instructions")? / steps,
            per_step_double: number(numbers, "double_instructions")? / steps,
            per_step_in_full: linearisation / (MONITORS * steps),
            prepare: number(numbers, "worn/prepare_instructions")?,
            linearisation,
            identify: number(numbers, "worn/identify_instructions")?,
            whole_each: [mean, each.into_iter().fold(0.0, f64::max)],
            relations: number(numbers, "relations_instructions")?,
            window_bytes: number(numbers, "window_bytes")?,
            ram_bytes: number(numbers, "static_bytes")? + number(numbers, "stack_bytes")?,
            flash_bytes: number(numbers, "flash_bytes")? - number(numbers, "case_bytes")?,
        })
    }

    fn ram_kib(&self) -> f64 {
        self.ram_bytes / 1024.0
    }
}

/// Monitors of one linearisation.
const MONITORS: f64 = 11.0;

fn number(numbers: &Numbers, name: &str) -> anyhow::Result<f64> {
    let text = numbers.get(name).with_context(|| format!("expected a line {name}"))?;
    text.parse().with_context(|| format!("{name} {text}"))
}

fn table(here: &Numbers, f: &Figures, windows: usize) -> anyhow::Result<String> {
    let rows = [
        (
            "instructions per monitor step, single precision",
            format!("{:.0}", f.per_step),
        ),
        (
            "the same in double precision, as identification runs it",
            format!("{:.0}", f.per_step_double),
        ),
        (
            "the same with its share of sensor words, residuals and sums",
            format!("{:.0}", f.per_step_in_full),
        ),
        (
            "making the window ready, million instructions",
            format!("{:.1}", f.prepare / 1e6),
        ),
        (
            "one linearisation, million instructions",
            format!("{:.1}", f.linearisation / 1e6),
        ),
        (
            "one identification, million instructions",
            format!("{:.0}", f.identify / 1e6),
        ),
        (
            "one identification at 480 MHz, s",
            format!("{:.2}", f.identify / CLOCK_HZ),
        ),
        (
            "making ready and identification of each window, million instructions: mean, most",
            format!("{:.0}, {:.0}", f.whole_each[0] / 1e6, f.whole_each[1] / 1e6),
        ),
        (
            "estimate by the relations of a commissioned unit, million instructions",
            format!("{:.1}", f.relations / 1e6),
        ),
        ("recorded window, KiB", format!("{:.1}", f.window_bytes / 1024.0)),
        (
            "all RAM: window, monitors or relations, search and stack, KiB",
            format!("{:.1}", f.ram_kib()),
        ),
        (
            "flash: program and constants, KiB",
            format!("{:.1}", f.flash_bytes / 1024.0),
        ),
        ("estimates", format!("the host's, bit for bit, in {windows} windows")),
    ];
    let mut text = String::from("| figure | emulated Cortex-M7 |\n|---|---|\n");
    for (name, value) in rows {
        text += &format!("| {name} | {value} |\n");
    }
    let printed = |name: &str| {
        here.get(name)
            .cloned()
            .with_context(|| format!("expected a line {name}"))
    };
    text += &format!(
        "\n{} monitor runs over the window. Error: {} % (root sum of squares).\n",
        printed("worn/evaluations")?,
        printed("rss_pct")?,
    );
    Ok(text)
}

/// Growth of a figure up to which the table need not be committed anew.
const GROWTH: f64 = 0.01;

/// Compares the rows of numbers with those of the same name in the committed document.
fn none_grew(document: &str, table: &str) -> anyhow::Result<()> {
    let rows = |text: &str| -> BTreeMap<String, Vec<f64>> {
        let cells = text.lines().filter_map(|line| {
            let (name, values) = line.strip_prefix("| ")?.strip_suffix(" |")?.split_once(" | ")?;
            let numbers = values.split(", ").map(|value| value.parse().ok());
            Some((name.to_owned(), numbers.collect::<Option<Vec<f64>>>()?))
        });
        cells.collect()
    };
    let (_, committed) = document
        .split_once(BEGIN)
        .with_context(|| format!("expected {BEGIN}"))?;
    let committed = rows(committed.split_once(END).map_or(committed, |(table, _)| table));
    for (name, found) in rows(table) {
        let before = committed.get(&name).map_or(&[][..], Vec::as_slice);
        for (found, before) in found.iter().zip(before) {
            ensure!(
                *found <= before * (1.0 + GROWTH),
                "{name}: {found}, before {before}; commit the new table of {DOCUMENT} if that is meant"
            );
        }
    }
    Ok(())
}

fn with_table(text: &str, table: &str) -> anyhow::Result<String> {
    let (before, rest) = text.split_once(BEGIN).with_context(|| format!("expected {BEGIN}"))?;
    let (_, after) = rest.split_once(END).with_context(|| format!("expected {END}"))?;
    Ok(format!("{before}{BEGIN}{table}{END}{after}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_may_grow_by_a_hundredth() {
        let document = |cells: &str| format!("text\n{BEGIN}| figure | here |\n|---|---|\n| a | {cells} |\n{END}");
        let grew = |cells: &str| none_grew(&document("100, 50"), &format!("| a | {cells} |\n")).is_err();
        assert!(!grew("101, 50") && !grew("90, 40") && !grew("the host's"));
        assert!(grew("102, 50") && grew("100, 51"));
        assert!(none_grew("no table", "").is_err());
    }
}

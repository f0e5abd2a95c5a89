//! Readers that nobody here wrote read what hmd writes: the MCAP reference library, `cantools` and `pyarrow`; and hmd reads what
//! `python-can` and `asammdf` write.

use std::fs;
use std::path::Path;

use anyhow::{Context, ensure};

use crate::programs::Programs;
use crate::python::Python;
use crate::shell::{program, root, run, run_to_file, target_dir};

/// What the readers are made of.
pub(crate) const PACKAGES: [&str; 6] = [
    "mcap==1.6.0",
    "mcap-protobuf-support==0.6.0",
    "cantools==45.1.0",
    "pyarrow==26.0.1",
    "python-can==4.6.1",
    "asammdf==8.8.28",
];

/// Recorded buses with layouts of their own, and the simulated logs behind them: options of `hmd simulate`.
const BUSES: [(&str, &str); 3] = [
    ("flap", "--rate 400 --noise 0.03 --fault friction=0.35 --seed 31"),
    ("rudder", "--rate 400 --noise 0.03 --fault backlash=0.2 --seed 32"),
    ("aileron", "--rate 400 --noise 0.03 --fault short_b=0.2 --seed 33"),
];

/// What `fixtures/foreign/make.py` makes of `text.log`.
const CONVERTED: [&str; 6] = [
    "text.asc",
    "text.blf",
    "text.mf4",
    "text-deflated.mf4",
    "text-transposed.mf4",
    "text-unfinalised.mf4",
];

/// What `fixtures/measured/make.py` makes of the samples of `text.log`.
const MEASURED: [&str; 10] = [
    "text.csv",
    "text-european.csv",
    "text-none.parquet",
    "text-snappy.parquet",
    "text-zstd.parquet",
    "text-gzip.parquet",
    "text-lz4.parquet",
    "text-signals.mf4",
    "text-signals-deflated.mf4",
    "text-signals-transposed.mf4",
];

/// Actuations in the simulated log.
const WINDOWS: usize = 2;

/// Random DBC files, of sixty messages each.
const RANDOM_DBCS: u32 = 10;

/// Makes a log, replays it, and lets the others read all of it.
pub(crate) fn check() -> anyhow::Result<()> {
    let python = Python::with_packages(&PACKAGES)?;
    let folder = target_dir()?.join("readers");
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let programs = Programs::build()?;
    mcap(&python, &programs, &folder)?;
    foreign(&python, &programs, &folder)?;
    tables(&python, &programs, &folder)?;
    dbc(&python, &programs, &folder)?;
    buses(&python, &programs, &folder)?;
    any_dbc(&python, &programs, &folder)
}

/// One run as text and as MCAP: both replay to the same records, and the reference library reads every file.
fn mcap(python: &Python, programs: &Programs, folder: &Path) -> anyhow::Result<()> {
    let hmd = programs.hmd();
    let [text, mcap] = ["text.log", "binary.mcap"].map(|name| folder.join(name));
    for log in [&text, &mcap] {
        let options = [
            "--rate",
            "400",
            "--fault",
            "friction=0.3",
            "--noise",
            "0.05",
            "--windows",
        ];
        run(program(&hmd, ["simulate"])
            .args(options)
            .arg(WINDOWS.to_string())
            .arg("-o")
            .arg(log))?;
    }
    let frames = fs::read_to_string(&text)
        .with_context(|| text.display().to_string())?
        .lines()
        .count();
    python.script_with(
        "fixtures/check_mcap.py",
        &[&mcap],
        &["--frames".to_owned(), frames.to_string()],
    )?;

    let mut records = Vec::new();
    for log in [&text, &mcap] {
        let replayed = log.with_extension("replayed.mcap");
        let lines = log.with_extension("jsonl");
        let mut replay = program(&hmd, ["replay", "--json", "-o"]);
        replay.arg(&replayed).arg(log);
        run_to_file(replay, None, &lines)?;
        let mut expected = vec!["--frames".to_owned(), frames.to_string()];
        for topic in ["window", "health", "rul"] {
            expected.extend(["--count".to_owned(), format!("/ema0/{topic}={WINDOWS}")]);
        }
        python.script_with("fixtures/check_mcap.py", &[&replayed], &expected)?;
        records.push(fs::read(&lines).with_context(|| lines.display().to_string())?);
    }
    ensure!(
        !records[0].is_empty() && records[0] == records[1],
        "the text log and the MCAP file replay differently"
    );
    Ok(())
}

/// The text log converted by `python-can` and `asammdf`: the same records, byte for byte; and how long each takes to read it.
fn foreign(python: &Python, programs: &Programs, folder: &Path) -> anyhow::Result<()> {
    let expected = folder.join("text.jsonl");
    let expected = fs::read(&expected).with_context(|| expected.display().to_string())?;
    python.script("fixtures/foreign/make.py", &[&folder.join("text.log"), folder])?;
    for name in CONVERTED {
        let log = folder.join(name);
        let lines = folder.join(format!("{name}.jsonl"));
        let mut replay = program(programs.hmd(), ["replay", "--json"]);
        replay.arg(&log);
        run_to_file(replay, None, &lines)?;
        let found = fs::read(&lines).with_context(|| lines.display().to_string())?;
        ensure!(found == expected, "{name}: replays to other records than text.log");
    }
    println!("{} converted logs replay to the same records", CONVERTED.len());
    python.script("fixtures/measured/make.py", &[&folder.join("text.log"), folder])?;
    for name in MEASURED {
        let log = folder.join(name);
        let lines = folder.join(format!("{name}.jsonl"));
        let mut replay = program(programs.hmd(), ["replay", "--json", "-c"]);
        replay.arg(root().join("fixtures/measured/map.toml")).arg(&log);
        run_to_file(replay, None, &lines)?;
        let found = fs::read(&lines).with_context(|| lines.display().to_string())?;
        ensure!(found == expected, "{name}: replays to other records than text.log");
    }
    println!("{} logs of measured signals replay to the same records", MEASURED.len());
    let long = folder.join("long.log");
    run(program(programs.hmd(), ["simulate", "--windows", "10", "-o"]).arg(&long))?;
    python.script("fixtures/foreign/make.py", &[&long, folder])?;
    let logs = ["long.asc", "long.blf", "long.mf4"].map(|name| folder.join(name));
    run(program(programs.example("read_log"), &logs))?;
    python.script("fixtures/foreign/speed.py", &logs.each_ref().map(|log| log.as_path()))
}

/// Both tables of a replayed log in both forms.
fn tables(python: &Python, programs: &Programs, folder: &Path) -> anyhow::Result<()> {
    let hmd = programs.hmd();
    let recorded = folder.join("text.replayed.mcap");
    for table in ["health", "samples"] {
        let [csv, parquet] = ["csv", "parquet"].map(|form| folder.join(table).with_extension(form));
        for out in [&csv, &parquet] {
            run(program(&hmd, ["export", "--table", table, "-o"])
                .arg(out)
                .arg(&recorded))?;
        }
        python.script("fixtures/check_table.py", &[&csv, &parquet])?;
    }
    Ok(())
}

/// Simulated and random frames, each signal decoded here and by `cantools` from the DBC file.
fn dbc(python: &Python, programs: &Programs, folder: &Path) -> anyhow::Result<()> {
    let example = |name| program(programs.example(name), [] as [&str; 0]);
    let random = folder.join("random.log");
    let mut make = example("random_candump");
    make.args(["20000", "1"]);
    run_to_file(make, None, &random)?;
    for log in [&folder.join("text.log"), &random] {
        let decoded = log.with_extension("decoded.jsonl");
        run_to_file(example("decode_candump"), Some(log), &decoded)?;
        python.script("fixtures/check_dbc.py", &[Path::new("fixtures/ema.dbc"), log, &decoded])?;
    }
    Ok(())
}

/// The recordings of other buses are what `cantools` encodes of simulated ones by their DBC files.
fn buses(python: &Python, programs: &Programs, folder: &Path) -> anyhow::Result<()> {
    let hmd = programs.hmd();
    for (bus, options) in BUSES {
        let ours = folder.join(format!("{bus}.simulated.log"));
        run(program(&hmd, ["simulate", "-o"])
            .arg(&ours)
            .args(options.split_whitespace()))?;
        let theirs = folder.join(format!("{bus}.log"));
        let translate = ["fixtures/buses/translate.py", bus];
        let mut translate = program(python.interpreter(), translate);
        translate.arg(&ours);
        run_to_file(translate, None, &theirs)?;
        let recorded = root().join("fixtures/buses").join(format!("{bus}.log"));
        let same = fs::read(&recorded).with_context(|| recorded.display().to_string())? == fs::read(&theirs)?;
        ensure!(same, "{}: expected what {} has", recorded.display(), theirs.display());
    }
    Ok(())
}

/// Random frames of random DBC files, each signal decoded here and by `cantools`.
fn any_dbc(python: &Python, programs: &Programs, folder: &Path) -> anyhow::Result<()> {
    let decode = programs.example("decode_dbc");
    let [database, frames, decoded] = ["any.dbc", "any.txt", "any.jsonl"].map(|name| folder.join(name));
    for seed in 1..=RANDOM_DBCS {
        run(program(
            python.interpreter(),
            ["fixtures/random_dbc.py", "make", &seed.to_string()],
        )
        .arg(&database)
        .arg(&frames))
        .with_context(|| format!("seed {seed}"))?;
        run_to_file(program(&decode, [&database]), Some(&frames), &decoded)?;
        run(program(python.interpreter(), ["fixtures/random_dbc.py", "check"]).args([&database, &frames, &decoded]))
            .with_context(|| format!("seed {seed}"))?;
    }
    Ok(())
}

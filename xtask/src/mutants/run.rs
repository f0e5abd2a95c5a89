//! Runs tests once for each mutant.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, OpenOptions};
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::{Mutex, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow, ensure};

use super::Module;
use super::copy::{Built, Program};
use super::switched::{Mutant, SWITCH};

/// Whether a test saw a mutant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// A test failed or did not end.
    Caught,
    /// All passed.
    Missed,
}

/// Names of the mutants that a test saw, in a file, so that a run can go on with the others.
pub(super) struct Seen {
    names: BTreeSet<String>,
    file: File,
}

impl Seen {
    /// Empty, unless what was seen before is not to be tried again.
    pub(super) fn kept_in(path: &Path, iterate: bool) -> anyhow::Result<Self> {
        if !iterate && path.exists() {
            fs::remove_file(path)?;
        }
        let file = OpenOptions::new().create(true).append(true).open(path)?;
        let names = fs::read_to_string(path)?.lines().map(str::to_owned).collect();
        Ok(Self { names, file })
    }
}

/// What runs so many times as long as without a mutant, and this much longer, does not end.
const TIMES_AS_LONG: u32 = 5;
const LONGER: Duration = Duration::from_secs(20);
/// Memory for one that takes ever more, KiB.
const MEMORY_KIB: u32 = 4 << 20;

/// How a program with tests ended.
enum Ended {
    Passed,
    /// With the name of a test that failed; without one it was aborted, or did not end.
    Failed(Option<String>),
}

/// Programs with tests of a module, and which of these saw other mutants.
pub(super) struct Run<'a> {
    /// With the time that each takes without a mutant, the quickest first.
    programs: Vec<(Duration, Program)>,
    numbers: Vec<usize>,
    module: &'a Module,
    mutants: &'a BTreeMap<usize, Mutant>,
    /// Tests that saw a mutant, by its file and the number of their program.
    keen: Mutex<BTreeMap<(&'a str, usize), BTreeSet<String>>>,
}

impl<'a> Run<'a> {
    /// Of tests that pass without a mutant.
    pub(super) fn new(built: Built, module: &'a Module, mutants: &'a BTreeMap<usize, Mutant>) -> anyhow::Result<Self> {
        let mut run = Self {
            programs: Vec::new(),
            numbers: built.mutants,
            module,
            mutants,
            keen: Mutex::new(BTreeMap::new()),
        };
        for program in built.programs {
            let begun = Instant::now();
            let ended = run.ended(&program, run.module.of_tests, 0, Duration::MAX)?;
            let name = program.0.display();
            ensure!(
                matches!(ended, Ended::Passed),
                "expected tests that pass without a mutant: {name}"
            );
            run.programs.push((begun.elapsed(), program));
        }
        run.programs.sort();
        Ok(run)
    }

    /// The outcome of each mutant, by its number.
    pub(super) fn outcomes(&self, seen: Seen) -> anyhow::Result<BTreeMap<usize, Outcome>> {
        let Seen { names, file } = seen;
        let (before, left): (Vec<usize>, Vec<usize>) = self
            .numbers
            .iter()
            .partition(|number| names.contains(&self.mutants[number].name));
        let outcomes = before.into_iter().map(|number| (number, Outcome::Caught)).collect();
        let (left, outcomes) = (Mutex::new(left.into_iter()), Mutex::new((outcomes, file)));
        let work = || -> anyhow::Result<()> {
            loop {
                let next = left.lock().ok().and_then(|mut left| left.next());
                let Some(number) = next else { return Ok(()) };
                let mutant = &self.mutants[&number];
                let outcome = self.outcome(number, mutant)?;
                let mut outcomes = outcomes.lock().map_err(|_| anyhow!("a thread panicked"))?;
                let (outcomes, file): &mut (BTreeMap<usize, Outcome>, File) = &mut outcomes;
                outcomes.insert(number, outcome);
                if outcome == Outcome::Caught {
                    writeln!(file, "{}", mutant.name)?;
                }
                eprintln!(
                    "{} of {}: {outcome:?} {}",
                    outcomes.len(),
                    self.numbers.len(),
                    mutant.name
                );
            }
        };
        thread::scope(|scope| {
            let workers = thread::available_parallelism().map_or(1, usize::from);
            let workers: Vec<_> = (0..workers).map(|_| scope.spawn(work)).collect();
            let mut ended = workers.into_iter().map(|worker| worker.join());
            ended.try_for_each(|ended| ended.unwrap_or_else(|_| Err(anyhow!("a thread panicked"))))
        })?;
        Ok(outcomes.into_inner().context("outcomes")?.0)
    }

    /// The outcome of one mutant: by the unit tests of its file and those that saw another mutant of it, then by all.
    fn outcome(&self, number: usize, mutant: &'a Mutant) -> anyhow::Result<Outcome> {
        let path = format!("{}::", mutant.module_path());
        let keen = |program| {
            let all = self.keen.lock().ok();
            all.and_then(|all| all.get(&(&*mutant.file, program)).cloned())
                .unwrap_or_default()
        };
        let quick = (0..self.programs.len()).map(|program| (program, keen(program)));
        let quick = quick.filter(|(_, tests)| !tests.is_empty());
        for (program, tests) in quick.collect::<Vec<_>>() {
            let tests: Vec<&str> = ["--exact"]
                .into_iter()
                .chain(tests.iter().map(String::as_str))
                .collect();
            if self.is_seen(program, &tests, number, mutant)? {
                return Ok(Outcome::Caught);
            }
        }
        for tests in [&[&*path][..], self.module.of_tests] {
            for program in 0..self.programs.len() {
                if self.is_seen(program, tests, number, mutant)? {
                    return Ok(Outcome::Caught);
                }
            }
        }
        Ok(Outcome::Missed)
    }

    fn is_seen(&self, program: usize, tests: &[&str], number: usize, mutant: &'a Mutant) -> anyhow::Result<bool> {
        let (takes, of) = &self.programs[program];
        match self.ended(of, tests, number, TIMES_AS_LONG * *takes + LONGER)? {
            Ended::Passed => Ok(false),
            Ended::Failed(test) => {
                if let (Some(test), Ok(mut keen)) = (test, self.keen.lock()) {
                    keen.entry((&mutant.file, program)).or_default().insert(test);
                }
                Ok(true)
            }
        }
    }

    /// How these tests in a program end, within a time, with a mutant; with none for 0. The first that fails is enough.
    fn ended(
        &self,
        (program, folder): &Program,
        tests: &[&str],
        mutant: usize,
        limit: Duration,
    ) -> anyhow::Result<Ended> {
        let script = format!("ulimit -v {MEMORY_KIB}; exec \"$0\" \"$@\"");
        let mut command = Command::new("sh");
        command.args(["-c", &script]).arg(program).args(tests);
        command.args(self.module.but_tests.iter().flat_map(|part| ["--skip", part]));
        command.current_dir(folder).env(SWITCH, mutant.to_string());
        // What a mutant says of itself is not read, and takes longer than many a test.
        command
            .env("RUST_BACKTRACE", "0")
            .stdin(Stdio::null())
            .stderr(Stdio::null());
        let child = command.stdout(Stdio::piped()).spawn();
        let mut child = child.with_context(|| program.display().to_string())?;
        let said = child.stdout.take().context("output of a test")?;
        let (ended, failed) = mpsc::channel();
        let reader = thread::spawn(move || {
            let mut lines = BufReader::new(said).lines().map_while(Result::ok);
            let failed =
                lines.find_map(|line| Some(line.strip_prefix("test ")?.strip_suffix(" ... FAILED")?.to_owned()));
            let _ = ended.send(failed);
        });
        let first = failed.recv_timeout(limit);
        if !matches!(first, Ok(None)) {
            child.kill()?;
        }
        let status = child.wait()?;
        let _ = reader.join();
        Ok(match first {
            Ok(None) if status.success() => Ended::Passed,
            Ok(failed) => Ended::Failed(failed),
            Err(_) => Ended::Failed(None),
        })
    }
}

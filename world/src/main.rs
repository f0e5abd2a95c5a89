//! Runs worlds: one seed, or many for a time.

use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

use clap::Parser;
use hmd_world::plan::Plan;
use hmd_world::{Outcome, run, shrink};

/// The whole daemon in a simulated world.
#[derive(Parser)]
struct Args {
    /// Run this seed alone, and print what the program said.
    #[arg(long)]
    seed: Option<u64>,
    /// Of that seed, with these disturbances alone, by their numbers.
    #[arg(long, value_delimiter = ',', requires = "seed")]
    only: Option<Vec<usize>>,
    /// Run seeds for so many seconds, from the first on; the first that fails is shortened.
    #[arg(long, default_value_t = 60)]
    seconds: u64,
    /// The first seed.
    #[arg(long, default_value_t = 1)]
    first: u64,
    /// End with the first failure, and do not shorten it.
    #[arg(long)]
    quick: bool,
    /// Most seeds.
    #[arg(long, default_value_t = u64::MAX)]
    seeds: u64,
}

fn main() -> anyhow::Result<ExitCode> {
    let args = Args::parse();
    if let Some(seed) = args.seed {
        let plan = Plan::of_seed(seed);
        let plan = match &args.only {
            Some(numbers) => plan.only(numbers),
            None => plan,
        };
        plan.disturbances.iter().for_each(|one| println!("{one}"));
        let outcome = run(&plan, true)?;
        return Ok(show(&outcome, seed));
    }
    let began = Instant::now();
    let next = AtomicU64::new(args.first);
    let fails_at = AtomicU64::new(u64::MAX);
    let worker = || -> anyhow::Result<Outcome> {
        let mut sum = Outcome::default();
        loop {
            let seed = next.fetch_add(1, Relaxed);
            let is_over = began.elapsed() >= Duration::from_secs(args.seconds) || seed - args.first >= args.seeds;
            if is_over || fails_at.load(Relaxed) < u64::MAX {
                return Ok(sum);
            }
            let outcome = run(&Plan::of_seed(seed), false)?;
            if !outcome.violations.is_empty() {
                fails_at.fetch_min(seed, Relaxed);
            }
            sum.add(&outcome);
        }
    };
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let sums: Vec<anyhow::Result<Outcome>> = thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(worker)).collect();
        let joined = workers.into_iter().map(|worker| worker.join());
        joined
            .map(|ended| ended.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    });
    let mut sum = Outcome::default();
    for outcome in sums {
        sum.add(&outcome?);
    }
    let (wall_s, seeds) = (began.elapsed().as_secs_f64(), next.load(Relaxed) - args.first);
    println!(
        "{seeds} seeds in {wall_s:.0} s: {:.1} actuator hours, {} disturbances, {} runs, {} windows, {} compared with a \
         replay, {} violations",
        sum.actuator_hours,
        sum.disturbances,
        sum.runs,
        sum.windows,
        sum.replayed,
        sum.violations.len()
    );
    println!(
        "per hour: {:.0} actuator hours, {:.0} disturbances",
        sum.actuator_hours / wall_s * 3600.0,
        sum.disturbances as f64 / wall_s * 3600.0
    );
    let failed = fails_at.load(Relaxed);
    if failed == u64::MAX {
        return Ok(ExitCode::SUCCESS);
    }
    let mut plan = Plan::of_seed(failed);
    if !args.quick {
        plan = shrink(&plan)?;
        println!("seed {failed}, {} s, shortened to:", plan.length.as_secs());
        plan.disturbances.iter().for_each(|one| println!("{one}"));
    }
    Ok(show(&run(&plan, false)?, failed))
}

fn show(outcome: &Outcome, seed: u64) -> ExitCode {
    for violation in outcome.violations.iter().take(20) {
        println!("violation: {violation}");
    }
    println!(
        "seed {seed}: {} violations, {} windows, {} compared with a replay",
        outcome.violations.len(),
        outcome.windows,
        outcome.replayed
    );
    ExitCode::from(u8::from(!outcome.violations.is_empty()))
}

"""The contract for engines that start programs: `python -m hmd.fleet.one LOG… -o OUT`.

With `--task I --of N` and a folder it takes every N-th log from the I-th on: a task of a Slurm array.
"""

import argparse
import sys
from pathlib import Path

from .._hmd import ConfigError
from .arguments import seed
from .contract import NO_LOGS, Found, Job, find_logs, one_log


def main(words: list[str] | None = None) -> int:
    """Exit codes as those of `hmd`: 0 done, 1 a log that cannot be read, or a folder of none, 78 bad configuration."""
    parser = argparse.ArgumentParser(prog="python -m hmd.fleet.one", description="Assess logs, a result for each.")
    parser.add_argument("logs", nargs="+", type=Path, help="logs, or folders of them")
    parser.add_argument("-o", "--output", required=True, type=Path, help="folder of the results")
    parser.add_argument("-c", "--config", type=Path, help="configuration; or a folder of them, UNIT.toml")
    parser.add_argument("--seed", type=seed, default=1, help="seed of the search")
    parser.add_argument("--task", type=int, default=0, help="number of this task, from 0")
    parser.add_argument("--of", type=int, default=1, help="number of tasks")
    args = parser.parse_args(words)
    if not 0 <= args.task < args.of:
        parser.error(f"--task: expected a number from 0 to {args.of - 1}, found {args.task}")
    try:
        job = Job.prepared(args.output, args.config, args.seed)
    except ConfigError as error:
        print(f"hmd.fleet: {error}", file=sys.stderr)
        return 78
    failed = 0
    logs: list[Path] = []
    for name in args.logs:
        found = find_logs(name, job) if name.is_dir() else Found([name], [])
        # Each task finds the same; one says so.
        for sentence in found.sentences() if args.task == 0 else ():
            print(f"hmd.fleet: {sentence}", file=sys.stderr)
        if not found.logs:
            failed += 1
            print(f"hmd.fleet: {name}: {NO_LOGS}", file=sys.stderr)
        logs += found.logs
    for log in logs[args.task :: args.of]:
        outcome = one_log(log.absolute(), job)
        if not outcome.key:
            failed += 1
            print(f"hmd.fleet: {outcome.log}: {outcome.message}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

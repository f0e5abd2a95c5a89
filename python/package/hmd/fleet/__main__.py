"""`python -m hmd.fleet FOLDER -o OUT`: a folder of logs on a Dask cluster, a table and a report of them."""

import argparse
import json
import os
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .._hmd import VERSION, ConfigError
from .arguments import seed, workers
from .cluster import assess_all
from .contract import NO_LOGS, Found, Index, Job, Outcome, find_logs, write_whole

STALE_S = 3600
"""Age at which a temporary file belongs to nobody any more."""


def main(words: list[str] | None = None) -> int:
    """Exit codes: 0 done, 1 no log at all, 3 done but some logs are bad or lost data, 78 bad configuration."""
    parser = argparse.ArgumentParser(
        prog="python -m hmd.fleet", description="Assess a folder of logs on a Dask cluster."
    )
    parser.add_argument("folder", type=Path, help="logs, in folders of any depth")
    parser.add_argument("-o", "--output", required=True, type=Path, help="folder of the results")
    parser.add_argument("-c", "--config", type=Path, help="configuration; or a folder of them, UNIT.toml")
    parser.add_argument("--seed", type=seed, default=1, help="seed of the search")
    parser.add_argument("--scheduler", metavar="ADDR", help="a Dask scheduler; this computer's cores without it")
    parser.add_argument("--workers", type=workers, default=os.cpu_count() or 1, help="local workers; 0: no Dask")
    args = parser.parse_args(words)
    try:
        return run(args.folder, args.output, args.config, args.seed, args.scheduler, args.workers)
    except ConfigError as error:
        print(f"hmd.fleet: {error}", file=sys.stderr)
        return 78
    except (OSError, ValueError) as error:
        print(f"hmd.fleet: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("hmd.fleet: interrupted; run again to go on", file=sys.stderr)
        return 130


def run(
    folder: Path, out: Path, config: Path | None = None, seed: int = 1, scheduler: str | None = None, workers: int = 1
) -> int:
    """Assesses logs without a result, then writes `fleet.parquet`, `fleet.json` and `report.html` unless they stand."""
    since = time.monotonic()
    folder, out = folder.absolute(), out.absolute()
    job = Job.prepared(out, config, seed)
    if not folder.is_dir():
        print(
            f"hmd.fleet: {folder}: expected a folder, found {'a file' if folder.exists() else 'none'}", file=sys.stderr
        )
        return 1
    out.mkdir(parents=True, exist_ok=True)
    found = find_logs(folder, job)
    logs = found.logs
    for sentence in found.sentences():
        print(f"hmd.fleet: {sentence}", file=sys.stderr)
    if not logs:
        print(f"hmd.fleet: {folder}: {NO_LOGS}", file=sys.stderr)
        return 1
    index = Index(out)
    outcomes = {str(log): known for log in logs if (known := index.find(log, job))}
    todo = [log for log in logs if str(log) not in outcomes]
    computed = 0

    def each(outcome: Outcome) -> None:
        nonlocal computed
        outcomes[outcome.log] = outcome
        computed += outcome.computed
        if sys.stderr.isatty():
            print(f"\r{len(outcomes)} of {len(logs)} logs", end="", file=sys.stderr, flush=True)

    if todo:
        try:
            assess_all(todo, job, scheduler=scheduler, workers=min(workers, len(todo)), each=each)
        finally:
            index.write([outcomes[log] for log in sorted(outcomes)])
            _sweep(out)
    _warn_of_units(job, logs)
    assessed_s = time.monotonic() - since
    summary = _write_tables(folder, out, job, found, [outcomes[str(log)] for log in logs])
    counts = summary["counts"]
    # Also those that a worker had done before it died.
    done = sum(bool(outcome.key) for outcome in outcomes.values()) - computed
    print(
        f"{counts['logs']} logs: {computed} assessed now, {done} were done, {counts['bad']} bad, "
        f"{counts['with_losses']} with losses, {counts['windows']} windows of {counts['units']} units; "
        f"{assessed_s:.1f} s to assess, {time.monotonic() - since:.1f} s in all"
    )
    return 3 if counts["bad"] or counts["with_losses"] else 0


def _write_tables(
    folder: Path, out: Path, job: Job, found: Found, outcomes: list[Outcome]
) -> dict[str, dict[str, int]]:
    # Here, because each worker that is started imports this file, and needs no tables.
    from .report import page
    from .statistics import Lists, read_units
    from .table import Results, inputs_of, is_current, write_table

    table, summary_file = out / "fleet.parquet", out / "fleet.json"
    inputs = inputs_of(job, outcomes, found.passed_over)
    # The summary comes last: made of these inputs, so are the others.
    if (
        is_current(table, inputs)
        and (out / "report.html").exists()
        and (made_before := _summary_of(summary_file, inputs))
    ):
        return made_before
    results = Results(folder, job, outcomes)
    windows = write_table(table, inputs, results.rows())
    units = read_units(table)
    counts = {
        "logs": len(outcomes),
        "judged": len(results.assessed),
        "bad": len(results.bad),
        "with_losses": len(results.lossy),
        "same_twice": len(results.twice),
        "passed_over": sum(some.files for some in found.passed_over),
        "windows": windows,
        "windows_twice": sum(same["windows"] for same in results.overlapping),
        "units": len(units),
    }
    made = {"version": VERSION, "configuration": job.identity, "seed": job.seed, "inputs": inputs}
    of_logs = {
        "bad": results.bad,
        "lossy": results.lossy,
        "twice": results.twice,
        "overlapping": results.overlapping,
        "passed_over": [asdict(some) for some in found.passed_over],
    }
    lists = Lists.of(units)
    summary = {"counts": counts, "made": made, **lists.as_json(), **of_logs}
    write_whole(out / "report.html", page(lists, summary))
    write_whole(summary_file, json.dumps(summary, indent=1) + "\n")
    return {"counts": counts}


def _summary_of(file: Path, inputs: str) -> dict[str, dict[str, int]] | None:
    """The summary of these inputs, if that is what stands in a file."""
    try:
        summary: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return summary if summary["made"]["inputs"] == inputs else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _warn_of_units(job: Job, logs: list[Path]) -> None:
    """Says which logs have no configuration of their unit, and which configurations no log: a misspelt name tells."""
    if job.config is None or not os.path.isdir(job.config):
        return
    used = [job.of(log).config for log in logs]
    without = sorted({log.parent.name for log, config in zip(logs, used, strict=True) if not _is_of_unit(config)})
    idle = sorted(
        {path.name for path in Path(job.config).glob("*.toml")} - {Path(config).name for config in used if config}
    )
    for names, what in ((without, "folders without a configuration of their unit"), (idle, "configurations of no log")):
        if names:
            more = f" and {len(names) - 10} more" if len(names) > 10 else ""
            print(f"hmd.fleet: warning: {what}: {', '.join(names[:10])}{more}", file=sys.stderr)


def _is_of_unit(config: str | None) -> bool:
    return config is not None and Path(config).name != "default.toml"


def _sweep(out: Path) -> None:
    """Removes what killed workers left behind; a younger file may still be written."""
    for left in out.glob("results/*/*.tmp"):
        if time.time() - left.stat().st_mtime > STALE_S:
            left.unlink(missing_ok=True)


if __name__ == "__main__":
    sys.exit(main())

"""What a fleet costs on this computer: `cargo xtask fleet`. Prints the figures that stand in docs/fleet.md.

measure_fleet.py FOLDER LOGS: simulates logs of one actuation at 400 Hz, ten of each unit, then assesses them with one
worker and with four, with four of which one is killed half-way, and once more.
"""

import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pyarrow.parquet as pq

import hmd

DAYS = 10
DAY_S = 86_400
PAIRS = 3
"""Runs with one worker and with four, in turn: the clock of a shared host changes from minute to minute."""
EPOCH_S = 1_700_000_000


def make(unit: int, folder: Path) -> None:
    """Ten logs of a unit, one a day; every tenth unit wears."""
    place = folder / f"unit-{unit:04}"
    if len(list(place.glob("day-*.log"))) == DAYS:
        return
    place.mkdir(parents=True, exist_ok=True)
    for day in range(DAYS):
        friction = 0.05 + (0.03 * day if unit % 10 == 0 else 0.0)
        log = place / f"new-{day:02}.log"
        hmd.simulate(log, faults={"friction": friction}, rate_hz=400, noise_a=0.03, seed=unit * DAYS + day + 1)
        text = log.read_text().replace(f"({EPOCH_S}.", f"({EPOCH_S + day * DAY_S}.")
        text = text.replace(f"({EPOCH_S + 1}.", f"({EPOCH_S + 1 + day * DAY_S}.")
        (place / f"day-{day:02}.log").write_text(text)
        log.unlink()
        Path(f"{log}.truth.jsonl").unlink()


def assess(folder: Path, out: Path, workers: int) -> float:
    """Seconds of a run, with everything: the start of Python and of the cluster, table and report."""
    before, busy_before, since = resource.getrusage(resource.RUSAGE_CHILDREN), busy_s(), time.monotonic()
    words = [sys.executable, "-m", "hmd.fleet", str(folder), "-o", str(out), "--workers", str(workers)]
    subprocess.run(words, check=True)
    seconds = time.monotonic() - since
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    others = max(0.0, busy_s() - busy_before - cpu) / seconds
    print(f"  {workers} workers: {seconds:.1f} s, {cpu:.0f} s of processors; others kept {others:.1f} busy", flush=True)
    return seconds


def busy_s() -> float:
    """Seconds that all processors together have worked, for anybody."""
    user, nice, system, _idle, _waiting, *interrupts = Path("/proc/stat").read_text().splitlines()[0].split()[1:9]
    return sum(map(int, [user, nice, system, *interrupts])) / os.sysconf("SC_CLK_TCK")


def kill_one(out: Path, results: int, coordinator_of: Path) -> None:
    """Kills a worker once that many results are there."""
    while len(list(out.glob("results/*/*.jsonl"))) < results:
        time.sleep(0.05)
    for process in Path("/proc").glob("[0-9]*"):
        try:
            command = (process / "cmdline").read_bytes()
            parent = next(line for line in (process / "status").read_text().splitlines() if line.startswith("PPid"))
            of = Path("/proc", parent.split()[1], "cmdline").read_bytes()
        except OSError:
            continue
        if b"spawn_main" in command and os.fsencode(coordinator_of) in of:
            os.kill(int(process.name), signal.SIGKILL)
            print(f"  killed worker {process.name} after {results} results", flush=True)
            return
    raise SystemExit("expected a worker to kill, found none")


def main() -> None:
    folder, count = Path(sys.argv[1]), int(sys.argv[2])
    logs = folder / "logs"
    units = count // DAYS
    since = time.monotonic()
    with ProcessPoolExecutor() as pool:
        list(pool.map(make, range(units), [logs] * units))
    print(f"{units * DAYS} logs of {units} units, made in {time.monotonic() - since:.0f} s")
    outs = {name: folder / name for name in ("one", "four", "killed")}
    shutil.rmtree(outs["killed"], ignore_errors=True)

    pairs = []
    for _ in range(PAIRS):
        shutil.rmtree(outs["one"], ignore_errors=True)
        shutil.rmtree(outs["four"], ignore_errors=True)
        pairs.append((assess(logs, outs["one"], 1), assess(logs, outs["four"], 4)))
        print(f"four workers: {pairs[-1][0] / pairs[-1][1]:.2f} times one", flush=True)
    one, four = (min(times) for times in zip(*pairs, strict=True))
    print(f"fastest of each: {one / four:.2f} times; {1e3 * one / count:.0f} ms of one worker for each log")
    killer = threading.Thread(target=kill_one, args=(outs["killed"], count // 2, outs["killed"]))
    killer.start()
    assess(logs, outs["killed"], 4)
    killer.join()
    again = assess(logs, outs["killed"], 4)
    print(f"again, with everything done: {again:.1f} s")

    tables = [pq.read_table(out / "fleet.parquet") for out in outs.values()]
    assert all(table.equals(tables[0]) for table in tables), "the tables differ"
    rows = list(zip(tables[0]["log"].to_pylist(), tables[0]["window"].to_pylist(), strict=True))
    assert len(rows) == len(set(rows)) == count, f"expected {count} rows, found {len(rows)}, {len(set(rows))} different"
    print(f"three tables, the same {count} rows, none twice")


if __name__ == "__main__":
    main()

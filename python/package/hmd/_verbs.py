"""Verbs of the program: each takes the command's options by name, and checks them as the command does."""

import json
import warnings
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, Literal

from . import _hmd
from ._arguments import (
    Path,
    Paths,
    checked_number,
    checked_path,
    checked_paths,
    checked_rate,
    checked_seed,
    checked_start,
    checked_threads,
)
from ._refusals import refusing
from ._tables import DataLossWarning


@refusing
def simulate(
    log: Path,
    *,
    k: Sequence[float] | None = None,
    faults: Mapping[str, float] | None = None,
    effects: Mapping[str, float] | None = None,
    drive: Literal["hysteresis", "vector"] | None = None,
    profile: Literal["step", "ramp", "chirp", "mixed"] = "mixed",
    mode: Literal["position", "speed"] = "position",
    windows: int = 1,
    start: datetime | None = None,
    rate_hz: float | None = None,
    noise_a: float = 0.0,
    load_nm: float = 0.0,
    actuator: str = "bench",
    id: int = 0,
    preset: Literal["cia402", "odrive", "moteus", "vesc", "damiao"] | None = None,
    output_encoder: bool = False,
    config: Path | None = None,
    seed: int = 1,
) -> None:
    """Writes `log` (`.mcap` or `.log`) with simulated actuations, and the truth as `LOG.truth.jsonl`: `hmd simulate`.

    `k` is the whole fault vector; `faults` sets single ones by name (`hmd.FAULT_PARAMETERS`). Without `rate_hz` it is
    the type's; `noise_a` is the current noise, A rms, `load_nm` a constant load at the output. `effects` are those of
    a real actuator by name, as `hmd simulate --list-effects` has them; `start` is when the log begins, with its time
    zone. `mode` is what the profile commands: the output angle or the motor speed. With `preset` the frames are those
    of a drive as it is sold, of node `id`, where `output_encoder` sends a second encoder at the output too.

    Raises `UsageError` with the command's own sentence, `Error` for a file that cannot be written.
    """
    options = [
        f"--output={checked_path('log', log)}",
        f"--profile={profile}",
        f"--mode={mode}",
        f"--windows={windows}",
        f"--noise={checked_number('noise_a', noise_a)!r}",
    ]
    options += [
        f"--load={checked_number('load_nm', load_nm)!r}",
        f"--actuator={actuator}",
        f"--id={id}",
        f"--seed={checked_seed(seed)}",
    ]
    if k is not None:
        options.append("--k=" + ",".join(repr(checked_number("k", value)) for value in k))
    options += [f"--fault={name}={checked_number(name, value)!r}" for name, value in (faults or {}).items()]
    options += [f"--with={name}={checked_number(name, value)!r}" for name, value in (effects or {}).items()]
    if rate_hz is not None:
        options.append(f"--rate={checked_rate(rate_hz)}")
    options += _given(config=config, drive=drive, preset=preset)
    if output_encoder:
        options.append("--output-encoder")
    if start is not None:
        options.append(f"--start={checked_start(start)}")
    _run("simulate", options)


@refusing
def calibrate(
    logs: Paths,
    output: Path,
    *,
    config: Path | None = None,
    name: str | None = None,
    report: Path | None = None,
    seed: int = 1,
    threads: int | None = None,
) -> list[str]:
    """Commissions one unit from logs in which it was healthy, and writes its calibration file: `hmd calibrate`.

    `logs` are files or folders, with five windows or more; `name` chooses the unit where they hold several. `report` is
    an HTML page of what was learnt.

    Returns what the command says: the smallest damage that shows, what was left out. Warns with `DataLossWarning` where
    a log lost data.

    Raises `Error` for too few windows, or for windows that differ too much, `ConfigError` for a bad configuration.
    """
    options = [f"--output={checked_path('output', output)}", f"--seed={checked_seed(seed)}"]
    options += _given(config=config, name=name, report=report)
    return _run("calibrate", options, checked_paths("logs", logs), checked_threads(threads))[1]


@refusing
def check_config(config: Path | None = None) -> dict[str, Any]:
    """What a configuration means, with every default: `hmd check-config --json`; `warnings` has what is unwise.

    Raises `ConfigError` with the sentence that the daemon would refuse it with.
    """
    text, _ = _run("check-config", ["--json", *_given(config=config)])
    meaning: dict[str, Any] = json.loads(text)
    return meaning


@refusing
def report(
    files: Paths,
    output: Path,
    *,
    actuator: str | None = None,
    config: Path | None = None,
    zone: str | None = None,
    pdf: Path | None = None,
) -> None:
    """Writes one HTML page about what `hmd` recorded: `hmd report`.

    `files` are recordings of `hmd.replay(..., output=...)` or of the daemon, or folders of them, in the order of time.
    The page is about all actuators, or about `actuator`; times are in `zone` (`"Europe/Berlin"`), else in this
    computer's. `pdf` needs Chromium.

    Raises `Error` for a file that is no recording. Warns with `DataLossWarning` where one is damaged.
    """
    options = [f"--output={checked_path('output', output)}"]
    options += _given(actuator=actuator, config=config, zone=zone, pdf=pdf)
    _run("report", options, checked_paths("files", files))


@refusing
def export(files: Paths, output: Path, *, table: Literal["health", "samples"] = "health") -> None:
    """Writes what `hmd` recorded as a table, `.csv` or `.parquet`: `hmd export`; `read_records` gives the same.

    Raises `Error` for a file that is no recording, is damaged and has no row, or has frames alone. Warns with
    `DataLossWarning` where one is damaged.
    """
    options = [f"--output={checked_path('output', output)}", f"--table={table}"]
    _run("export", options, checked_paths("files", files))


def _given(**options: Path | None) -> list[str]:
    """The options that are not `None`, as the command takes them."""
    given = {name: value for name, value in options.items() if value is not None}
    return [f"--{name}={checked_path(name, value)}" for name, value in given.items()]


def _run(verb: str, options: list[str], files: Sequence[str] = (), threads: int = 0) -> tuple[str, list[str]]:
    """Runs a verb; what it would write to standard output, and what to standard error."""
    # A file may be called as an option is.
    text, messages, data_lost = _hmd.run([verb, *options, "--", *files], threads)
    if data_lost:
        warnings.warn("; ".join(messages), DataLossWarning, stacklevel=4)
    return text, messages

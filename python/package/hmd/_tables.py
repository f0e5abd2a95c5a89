"""Logs and records as Arrow tables."""

import warnings
from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Literal

from . import _hmd

if TYPE_CHECKING:
    import pyarrow

Path = str | PathLike[str]
Paths = Path | Sequence[Path]


class DataLossWarning(UserWarning):
    """Parts of a file could not be read and were passed over; the rest is there."""


def many(paths: Paths) -> list[Path]:
    """One path or several, as a list."""
    return [paths] if isinstance(paths, str | PathLike) else list(paths)


def to_pyarrow(table: _hmd.ArrowTable) -> "pyarrow.Table":
    """The table for pyarrow, which is imported only here: judging needs none."""
    import pyarrow

    return pyarrow.table(table)


def read_records(files: Paths, table: Literal["health", "samples"] = "health") -> "pyarrow.Table":
    """The records of MCAP files that `hmd` wrote, in the order of time, as `hmd export` gives them.

    `health` has a row for each window: status, health, faults, k1 to k8 with sigmas, damage, remaining life. `samples`
    has a row for each stored sample of each window: setpoint, measured and fitted current, speed and position.

    Raises `Error` for a file that is none of ours. Warns with `DataLossWarning` where parts of a file are damaged.
    """
    rows, damaged = _hmd.read_records(many(files), table)
    return _warned(rows, damaged, files)


def read_raw(logs: Paths, *, config: Path | None = None) -> "pyarrow.Table":
    """The samples of logs (MCAP or candump text), a row for each: currents in A, counts, setpoint with its mode, rate.

    They are decoded and their counters continued, but nothing is filled or refused yet. Supply, winding temperature and
    load are what the status frames last said. `config` is needed for a bus with a layout of its own.

    Raises `Error` for what is no log. Warns with `DataLossWarning` where parts of it cannot be read.
    """
    rows, damaged = _hmd.read_raw(many(logs), config)
    return _warned(rows, damaged, logs)


def _warned(rows: _hmd.ArrowTable, damaged: bool, files: Paths) -> "pyarrow.Table":
    if damaged:
        names = ", ".join(str(file) for file in many(files))
        warnings.warn(f"{names}: parts could not be read", DataLossWarning, stacklevel=3)
    return to_pyarrow(rows)

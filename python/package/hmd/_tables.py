"""Logs and records as Arrow tables."""

import json
import warnings
from typing import TYPE_CHECKING, Literal

from . import _hmd
from ._arguments import Path, Paths, checked_paths, optional_path
from ._refusals import refusing

if TYPE_CHECKING:
    import pyarrow


PLACES = 20
"""Places of a loss that a warning names one by one."""


class DataLossWarning(UserWarning):
    """Parts of a file could not be read and were passed over; the rest is there."""


def to_pyarrow(table: _hmd.ArrowTable) -> "pyarrow.Table":
    """The table for pyarrow, which is imported only here: judging needs none."""
    import pyarrow

    found = pyarrow.table(table)
    return found.replace_schema_metadata(metadata_of(found.schema))


def metadata_of(schema: "pyarrow.Schema") -> dict[str, str]:
    """Metadata of a table, as `hmd export` writes them into Parquet files: units of columns, and types in pandas.

    There flags are `boolean`, whether or not one is absent. Without it they would be `bool` or, beside an absent one,
    `object`. The form is that of pandas: developer guide, "Storing pandas DataFrame objects in Apache Parquet format".
    """
    import pyarrow

    flags = [field.name for field in schema if pyarrow.types.is_boolean(field.type)]
    column = {"pandas_type": "bool", "numpy_type": "boolean", "metadata": None}
    columns = [{"name": name, "field_name": name, **column} for name in flags]
    return {
        "units": json.dumps({field.name: field.metadata[b"unit"].decode() for field in schema if field.metadata}),
        "pandas": json.dumps({"index_columns": [], "column_indexes": [], "columns": columns}),
    }


@refusing
def read_records(files: Paths, table: Literal["health", "samples"] = "health") -> "pyarrow.Table":
    """The records of MCAP files that `hmd` wrote, or folders of them, in the order given, as `hmd export` gives them.

    `health` has a row for each window: status, health, faults, k1 to k8 with sigmas, damage, remaining life. `samples`
    has a row for each stored sample of each window: setpoint, measured and fitted current, speed and position.

    A recording in which no actuation was recorded is a table without rows. Raises `Error` for a file that has none for
    another reason: not ours, damaged, or frames alone. Warns with `DataLossWarning` where parts of a file are damaged.
    """
    names = checked_paths("files", files, in_order=False)
    rows, lost = _hmd.read_records(names, table)
    return _warned(rows, lost)


@refusing
def read_raw(logs: Paths, *, config: Path | None = None) -> "pyarrow.Table":
    """The samples of logs or folders of them, a row for each: currents in A, counts, setpoint with its mode, rate.

    They are decoded and their counters continued, but nothing is filled or refused yet. Supply, winding temperature and
    load are what the status frames last said. `file` is the log, `serial_number` that of the configuration or else of
    the log. `config` is needed for a bus with a layout of its own, and for logs of measured signals (`[map]`).

    Raises `Error` for what is no log. Warns with `DataLossWarning` where parts of it cannot be read.
    """
    names = checked_paths("logs", logs)
    rows, lost = _hmd.read_raw(names, optional_path("config", config))
    return _warned(rows, lost)


def _warned(rows: _hmd.ArrowTable, lost: list[str]) -> "pyarrow.Table":
    if len(lost) > PLACES + 1:
        # The last one says how much it is in all.
        lost = [*lost[:PLACES], f"{len(lost) - 1 - PLACES} more", lost[-1]]
    if lost:
        warnings.warn("; ".join(lost), DataLossWarning, stacklevel=4)
    return to_pyarrow(rows)

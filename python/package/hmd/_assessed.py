"""Windows assessed: of logs, and of samples in arrays."""

import json
import warnings
from collections import Counter
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, overload

from . import _hmd
from ._arguments import (
    Path,
    Paths,
    checked_paths,
    checked_rate,
    checked_seed,
    checked_start,
    checked_threads,
    optional_number,
    optional_path,
)
from ._hmd import UsageError
from ._refusals import refusing
from ._tables import DataLossWarning, to_pyarrow

if TYPE_CHECKING:
    import pandas
    import polars
    import pyarrow
    from numpy.typing import ArrayLike

COUNTS_MAX = 2**52
"""Largest count: a number of 64 bits holds its fractions too."""


class Judged:
    """What was assessed; its length is the number of windows, and iterating gives those of `windows`."""

    def __init__(self, assessed: _hmd.Judged) -> None:
        self._lines = assessed.lines
        self._notices = assessed.notices
        self._loss = assessed.loss
        self._table: _hmd.ArrowTable | pyarrow.Table = assessed.table

    def __getstate__(self) -> dict[str, Any]:
        # pyarrow's own tables go from process to process.
        return {**self.__dict__, "_table": self.to_arrow()}

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Judged):
            return NotImplemented
        return (self.lines, self.notices, self.loss) == (other.lines, other.notices, other.loss)

    __hash__ = None  # type: ignore[assignment]

    @property
    def lines(self) -> list[str]:
        """The lines of `hmd replay --json`, byte for byte."""
        return self._lines

    @property
    def windows(self) -> list[dict[str, Any]]:
        """The same as objects: actuator, window, status, k, sigma, observable, cost, evaluations, health and so on."""
        return list(self)

    def __len__(self) -> int:
        return len(self._lines)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return map(json.loads, self._lines)

    @overload
    def __getitem__(self, place: int) -> dict[str, Any]: ...
    @overload
    def __getitem__(self, place: slice) -> list[dict[str, Any]]: ...
    def __getitem__(self, place: int | slice) -> dict[str, Any] | list[dict[str, Any]]:
        return self.windows[place]

    def __repr__(self) -> str:
        windows = Counter((window["actuator"], window["health"]) for window in self)
        found = ", ".join(f"{number} of {actuator} {health}" for (actuator, health), number in windows.items())
        count = f"{len(self)} window{'s' if len(self) > 1 else ''}" if found else "no windows"
        return f"<hmd.Judged, {count}{': ' if found else ''}{found}{', data lost' if self.loss else ''}>"

    @property
    def notices(self) -> list[str]:
        """What `hmd replay` says beside its lines, a sentence each: what a configuration or a log means for them."""
        return self._notices

    @property
    def loss(self) -> str | None:
        """What was lost on the way (the program's exit code 3), or `None`."""
        return self._loss

    def to_arrow(self) -> "pyarrow.Table":
        """A row for each window, with the columns of `hmd export`."""
        return to_pyarrow(self._table)

    def to_pandas(self) -> "pandas.DataFrame":
        """The same for pandas, which must be installed; what is unknown is NaN, of flags (`boolean`) `pandas.NA`."""
        return self.to_arrow().to_pandas()

    def to_polars(self) -> "polars.DataFrame":
        """The same for polars, which must be installed; what is unknown is null."""
        import polars

        return polars.DataFrame(self.to_arrow())


@refusing
def replay(
    logs: Paths,
    *,
    config: Path | None = None,
    seed: int = 1,
    output: Path | None = None,
    threads: int | None = None,
) -> Judged:
    """Assesses logs in the order of time, as `hmd replay LOG… -c CONFIG --seed SEED -o OUTPUT` does.

    `logs` are files or folders of them, in the order of time. The result does not depend on `threads` (all cores
    without it). Other Python threads go on meanwhile. In its tables `file` is the log that a window began in.

    Raises `ConfigError` for a bad configuration, `Error` for a log that cannot be read at all or holds no actuator.
    Warns with `DataLossWarning` where data were lost; then `loss` says what.
    """
    names = checked_paths("logs", logs)
    config, output = optional_path("config", config), optional_path("output", output)
    found = Judged(_hmd.replay(names, config, output, checked_seed(seed), checked_threads(threads)))
    if found.loss:
        warnings.warn(f"{', '.join(names)}: {found.loss}", DataLossWarning, stacklevel=3)
    return found


@refusing
def identify(
    currents_a: "ArrayLike",
    motor_counts: "ArrayLike",
    output_counts: "ArrayLike",
    setpoint: "ArrayLike",
    mode: "ArrayLike",
    *,
    rate_hz: float,
    seq: "ArrayLike | None" = None,
    t_ns: "ArrayLike | None" = None,
    dc_link_v: float | None = None,
    winding_temp_c: float | None = None,
    load_torque_nm: float | None = None,
    actuator: str = "ema0",
    config: Path | None = None,
    seed: int = 1,
    threads: int | None = None,
) -> Judged:
    """Finds the actuations in samples of one actuator and identifies each, as `replay` does with those of a log.

    - `currents_a`: phase currents i_a, i_b, i_c, A, shape (n, 3);
    - `motor_counts`, `output_counts`: resolver and encoder, whole counts, continued over their wraps;
    - `setpoint`: rad at the output shaft (mode `"position"`) or rad/s at the motor shaft (`"speed"`); NaN when idle;
    - `mode`: one word for all samples or one for each: `"idle"`, `"position"` or `"speed"`;
    - `rate_hz`: samples per second; `seq`: sample numbers, where some are missing; `t_ns`: UTC of each sample, as
      nanoseconds or as times, from 0 without it; both rise;
    - supply, winding temperature and load at the output, if they were measured.

    `actuator` is a name of the configuration, which gives its type and calibration; without a configuration `ema0` to
    `ema15` are actuators of the bench. Too few samples, no actuation, or bad data give an empty or an `invalid` result,
    never a fault.

    Raises `UsageError` for columns that do not fit each other, `ConfigError` for a bad configuration.
    """
    import numpy as np

    rate_hz = checked_rate(rate_hz)
    currents = np.asarray(currents_a, dtype=np.float64)
    if currents.ndim != 2 or currents.shape[1] != 3:
        raise UsageError(f"currents_a: expected the shape (n, 3), found {currents.shape}")
    n = len(currents)
    numbers = np.arange(n) if seq is None else np.asarray(seq)
    times = np.rint((numbers - numbers[:1].sum()) * (1e9 / rate_hz)) if t_ns is None and n else _nanoseconds(t_ns)
    for name, values in (("seq", numbers), ("t_ns", times)):
        if len(values) > 1 and not (np.diff(values.astype(np.float64)) > 0).all():
            raise UsageError(f"{name}: expected values that rise, found some that do not")
    names = np.asarray(mode, dtype=np.str_)
    modes = np.full(names.shape, -1, dtype=np.int64)
    for code, name in enumerate(("idle", "position", "speed")):
        modes[names == name] = code
    if (modes < 0).any():
        raise UsageError(f"mode: expected idle, position or speed, found {str(names[modes < 0].flat[0])!r}")
    columns = {
        "seq": _whole("seq", numbers),
        "t_ns": _whole("t_ns", times),
        "i_a_a": np.ascontiguousarray(currents[:, 0]),
        "i_b_a": np.ascontiguousarray(currents[:, 1]),
        "i_c_a": np.ascontiguousarray(currents[:, 2]),
        "motor_counts": _counts("motor_counts", motor_counts),
        "output_counts": _counts("output_counts", output_counts),
        "mode": np.ascontiguousarray(np.broadcast_to(modes, (n,)) if modes.ndim == 0 else modes),
        "setpoint": np.ascontiguousarray(setpoint, dtype=np.float64),
    }
    measured = {
        name: optional_number(name, value)
        for name, value in (
            ("dc_link_v", dc_link_v),
            ("winding_temp_c", winding_temp_c),
            ("load_torque_nm", load_torque_nm),
        )
    }
    config, threads = optional_path("config", config), checked_threads(threads)
    return Judged(_hmd.identify(columns, rate_hz, measured, actuator, config, checked_seed(seed), threads))


def _nanoseconds(times: "ArrayLike | None") -> Any:
    """UTC of each sample, ns: numbers as they are, times of any unit and zone."""
    import numpy as np

    given = np.asarray([] if times is None else times)
    # pandas gives times with a zone as objects.
    if given.dtype.kind == "O":
        given = np.asarray([_time_ns(time) for time in given])
    return given.astype("datetime64[ns]").astype(np.int64) if given.dtype.kind == "M" else given


def _time_ns(time: Any) -> Any:
    """A time of pandas or of Python as UTC ns, without a zone taken as UTC; a number as it is."""
    if hasattr(time, "value"):
        return time.value
    if not isinstance(time, datetime):
        return time
    return checked_start(time if time.tzinfo else time.replace(tzinfo=UTC))


def _counts(name: str, values: "ArrayLike") -> Any:
    """Whole counts, of which angles lose nothing."""
    import numpy as np

    counts = _whole(name, values)
    if counts.size and (counts.min() < -COUNTS_MAX or counts.max() > COUNTS_MAX):
        raise UsageError(f"{name}: expected counts up to 2⁵² in size, found {int(np.abs(counts.astype(float)).max())}")
    return counts


def _whole(name: str, values: "ArrayLike") -> Any:
    """Whole numbers; what would lose a fraction is refused."""
    import numpy as np

    given = np.asarray(values)
    if given.size and not np.abs(given.astype(np.float64)).max() < 2.0**63:
        raise UsageError(f"{name}: expected whole numbers below 2⁶³, found others")
    whole = np.ascontiguousarray(given, dtype=np.int64) if given.dtype.kind in "iu" else _rounded(name, given)
    if whole.ndim != 1:
        raise UsageError(f"{name}: expected one dimension, found {whole.ndim}")
    return whole


def _rounded(name: str, given: Any) -> Any:
    import numpy as np

    if given.size and not (np.isfinite(given).all() and (given == np.rint(given)).all()):
        raise UsageError(f"{name}: expected whole numbers, found a fraction or none")
    return np.ascontiguousarray(given, dtype=np.int64)

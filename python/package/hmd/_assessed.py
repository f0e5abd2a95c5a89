"""Windows assessed: of logs, and of samples in arrays."""

import json
from typing import TYPE_CHECKING, Any

from . import _hmd
from ._hmd import UsageError
from ._tables import Path, Paths, many, to_pyarrow

if TYPE_CHECKING:
    import pyarrow
    from numpy.typing import ArrayLike


class Judged:
    """What was assessed, window by window."""

    def __init__(self, assessed: _hmd.Judged) -> None:
        self._assessed = assessed

    @property
    def lines(self) -> list[str]:
        """The lines of `hmd replay --json`, byte for byte."""
        return self._assessed.lines

    @property
    def windows(self) -> list[dict[str, Any]]:
        """The same as objects: actuator, window, status, k, sigma, observable, cost, evaluations, health and so on."""
        return [json.loads(line) for line in self._assessed.lines]

    @property
    def notices(self) -> list[str]:
        """What an operator should read, a sentence each."""
        return self._assessed.notices

    @property
    def loss(self) -> str | None:
        """What was lost on the way (the program's exit code 3), or `None`."""
        return self._assessed.loss

    def to_arrow(self) -> "pyarrow.Table":
        """A row for each window, with the columns of `hmd export`."""
        return to_pyarrow(self._assessed.table)


def replay(
    logs: Paths,
    *,
    config: Path | None = None,
    seed: int = 1,
    output: Path | None = None,
    threads: int | None = None,
) -> Judged:
    """Assesses logs in the order of time, as `hmd replay LOG… -c CONFIG --seed SEED -o OUTPUT` does.

    The result does not depend on `threads` (all cores without it). Other Python threads go on meanwhile.

    Raises `ConfigError` for a bad configuration, `Error` for a log that cannot be read at all or holds no actuator.
    """
    return Judged(_hmd.replay(many(logs), config, output, seed, threads or 0))


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
    - `rate_hz`: samples per second; `seq`: sample numbers, where some are missing; `t_ns`: UTC of each sample, from 0
      without it;
    - supply, winding temperature and load at the output, if they were measured.

    `actuator` is a name of the configuration, which gives its type and calibration; without a configuration `ema0` to
    `ema15` are actuators of the bench. Too few samples, no actuation, or bad data give an empty or an `invalid` result,
    never a fault.

    Raises `UsageError` for columns that do not fit each other, `ConfigError` for a bad configuration.
    """
    import numpy as np

    currents = np.asarray(currents_a, dtype=np.float64)
    if currents.ndim != 2 or currents.shape[1] != 3:
        raise UsageError(f"currents_a: expected the shape (n, 3), found {currents.shape}")
    n = len(currents)
    numbers = np.arange(n) if seq is None else np.asarray(seq)
    if t_ns is None:
        t_ns = np.rint((numbers - numbers[:1].sum()) * (1e9 / rate_hz)) if n else []
    names = np.asarray(mode, dtype=np.str_)
    modes = np.full(names.shape, -1, dtype=np.int64)
    for code, name in enumerate(("idle", "position", "speed")):
        modes[names == name] = code
    if (modes < 0).any():
        raise UsageError(f"mode: expected idle, position or speed, found {str(names[modes < 0].flat[0])!r}")
    columns = {
        "seq": _whole("seq", numbers),
        "t_ns": _whole("t_ns", t_ns),
        "i_a_a": np.ascontiguousarray(currents[:, 0]),
        "i_b_a": np.ascontiguousarray(currents[:, 1]),
        "i_c_a": np.ascontiguousarray(currents[:, 2]),
        "motor_counts": _whole("motor_counts", motor_counts),
        "output_counts": _whole("output_counts", output_counts),
        "mode": np.ascontiguousarray(np.broadcast_to(modes, (n,)) if modes.ndim == 0 else modes),
        "setpoint": np.ascontiguousarray(setpoint, dtype=np.float64),
    }
    measured = {"dc_link_v": dc_link_v, "winding_temp_c": winding_temp_c, "load_torque_nm": load_torque_nm}
    return Judged(_hmd.identify(columns, rate_hz, measured, actuator, config, seed, threads or 0))


def _whole(name: str, values: "ArrayLike") -> Any:
    """Whole numbers; what would lose a fraction is refused."""
    import numpy as np

    given = np.asarray(values)
    whole = np.ascontiguousarray(given, dtype=np.int64) if given.dtype.kind in "iu" else _rounded(name, given)
    if whole.ndim != 1:
        raise UsageError(f"{name}: expected one dimension, found {whole.ndim}")
    return whole


def _rounded(name: str, given: Any) -> Any:
    import numpy as np

    if given.size and not (np.isfinite(given).all() and (given == np.rint(given)).all()):
        raise UsageError(f"{name}: expected whole numbers, found a fraction or none")
    return np.ascontiguousarray(given, dtype=np.int64)

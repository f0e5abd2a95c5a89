"""A log of the reference model."""

import os
from collections.abc import Mapping, Sequence
from typing import Literal

from . import _hmd
from ._tables import Path


def simulate(
    log: Path,
    *,
    k: Sequence[float] | None = None,
    faults: Mapping[str, float] | None = None,
    profile: Literal["step", "ramp", "chirp", "mixed"] = "mixed",
    windows: int = 1,
    rate_hz: float | None = None,
    noise_a: float = 0.0,
    load_nm: float = 0.0,
    actuator: str = "bench",
    id: int = 0,
    config: Path | None = None,
    seed: int = 1,
) -> None:
    """Writes `log` (`.mcap` or `.log`) with simulated actuations, and the truth as `LOG.truth.jsonl`: `hmd simulate`.

    `k` is the whole fault vector; `faults` sets single ones by name (friction, backlash, short_a, short_b, short_c,
    eccentricity, eccentricity_phase, gain). Without `rate_hz` it is the type's; `noise_a` is the current noise, A rms,
    `load_nm` a constant load at the output.

    Raises `UsageError` with the command's own sentence, `Error` for a file that cannot be written.
    """
    options = [
        f"--output={os.fspath(log)}",
        f"--profile={profile}",
        f"--windows={windows}",
        f"--noise={float(noise_a)!r}",
    ]
    options += [f"--load={float(load_nm)!r}", f"--actuator={actuator}", f"--id={id}", f"--seed={seed}"]
    if k is not None:
        options.append("--k=" + ",".join(repr(float(value)) for value in k))
    options += [f"--fault={name}={float(value)!r}" for name, value in (faults or {}).items()]
    if rate_hz is not None:
        options.append(f"--rate={float(rate_hz)!r}")
    if config is not None:
        options.append(f"--config={os.fspath(config)}")
    _hmd.simulate(options)

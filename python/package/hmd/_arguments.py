"""What the functions take, checked before the compiled half sees it, by the names that Python code gives it."""

import math
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from os import PathLike, fspath

from ._hmd import UsageError

Path = str | PathLike[str]
Paths = Path | Iterable[Path]

THREADS_MAX = 1024


def checked_paths(name: str, paths: Paths, *, in_order: bool = True) -> list[str]:
    """One path or several, as texts; a set has no order, and is refused where the order matters."""
    if in_order and isinstance(paths, set | frozenset):
        raise UsageError(f"{name}: expected paths in the order of time, found a {type(paths).__name__}")
    several = [paths] if isinstance(paths, str | bytes | PathLike) else list(paths)
    if not several:
        raise UsageError(f"{name}: expected a file or folder, found none")
    return [checked_path(name, path) for path in several]


def checked_path(name: str, path: Path) -> str:
    """A path as text."""
    text = fspath(path) if isinstance(path, str | PathLike) else path
    if not isinstance(text, str):
        raise UsageError(f"{name}: expected a path as text or pathlib.Path, found {text!r}")
    return text


def optional_path(name: str, path: Path | None) -> str | None:
    """The same where it may be left out."""
    return None if path is None else checked_path(name, path)


def checked_threads(threads: int | None) -> int:
    """The number of threads; 0 for all cores."""
    if threads is None:
        return 0
    return _whole("threads", threads, 1, THREADS_MAX)


def checked_seed(seed: int) -> int:
    """A seed of 64 bits."""
    return _whole("seed", seed, 0, 2**64 - 1)


def checked_start(start: datetime) -> int:
    """A time with its zone, as UTC ns."""
    if not isinstance(start, datetime) or start.tzinfo is None:
        raise UsageError(f"start: expected a datetime with a time zone, found {start!r}")
    since_1970 = start - datetime(1970, 1, 1, tzinfo=UTC)
    return since_1970 // timedelta(microseconds=1) * 1000


def checked_rate(rate_hz: float) -> float:
    """A sample rate."""
    rate = checked_number("rate_hz", rate_hz)
    if not (math.isfinite(rate) and rate > 0.0):
        raise UsageError(f"rate_hz: expected a number above 0, found {rate_hz!r}")
    return rate


def checked_number(name: str, value: float) -> float:
    """A number."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise UsageError(f"{name}: expected a number, found {type(value).__name__}") from None


def optional_number(name: str, value: float | None) -> float | None:
    """A number where it may be left out."""
    return None if value is None else checked_number(name, value)


def _whole(name: str, value: int, least: int, most: int) -> int:
    is_whole = not isinstance(value, bool) and hasattr(value, "__index__")
    if not (is_whole and least <= value.__index__() <= most):
        raise UsageError(f"{name}: expected a whole number from {least} to {most}, found {value!r}")
    return value.__index__()

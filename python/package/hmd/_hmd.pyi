"""The compiled half of the package; use what `hmd` itself offers."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

VERSION: str

class Error(Exception): ...
class ConfigError(Error): ...
class UsageError(Error): ...

class ArrowTable:
    def __arrow_c_stream__(self, requested_schema: object | None = None) -> Any: ...

class Judged:
    @property
    def lines(self) -> list[str]: ...
    @property
    def notices(self) -> list[str]: ...
    @property
    def loss(self) -> str | None: ...
    @property
    def table(self) -> ArrowTable: ...

def replay(
    logs: Sequence[str | PathLike[str]],
    config: str | PathLike[str] | None,
    output: str | PathLike[str] | None,
    seed: int,
    threads: int,
) -> Judged: ...
def identify(
    columns: Mapping[str, NDArray[np.float64] | NDArray[np.int64]],
    rate_hz: float,
    measured: Mapping[str, float | None],
    actuator: str,
    config: str | PathLike[str] | None,
    seed: int,
    threads: int,
) -> Judged: ...
def read_records(files: Sequence[str | PathLike[str]], table: str) -> tuple[ArrowTable, bool]: ...
def read_raw(logs: Sequence[str | PathLike[str]], config: str | PathLike[str] | None) -> tuple[ArrowTable, bool]: ...
def config_identity(
    config: str | PathLike[str] | None,
) -> tuple[str, str, list[str]]: ...
def serial_numbers(log: str | PathLike[str]) -> dict[str, str]: ...
def simulate(options: Sequence[str]) -> None: ...

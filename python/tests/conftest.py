"""Logs for the tests: simulated, or recorded ones of this repository; and the program, where it was built."""

import os
from pathlib import Path

import pytest

import hmd

REPOSITORY = Path(__file__).resolve().parents[2]

# Configuration of an actuator that is its data sheet, as the simulated ones are.
EXACT = 'type.bench.tolerances = "exact"\n'


@pytest.fixture(scope="session")
def program() -> str:
    """The program `hmd` that results are compared with."""
    path = os.environ.get("HMD_PROGRAM")
    assert path, "expected the path of the program in HMD_PROGRAM (cargo xtask python sets it)"
    return path


@pytest.fixture(scope="session")
def worn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log with two actuations of a worn actuator."""
    log = tmp_path_factory.mktemp("worn") / "worn.log"
    hmd.simulate(log, faults={"friction": 0.4, "short_b": 0.15}, noise_a=0.03, windows=2, rate_hz=400, seed=7)
    return log

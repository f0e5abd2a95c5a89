"""`hmd.replay` is `hmd replay --json`, to the last bit."""

import json
import math
import pickle
import subprocess
import threading
import time
import warnings
from pathlib import Path

import pandas
import polars
import pytest
from conftest import EXACT, REPOSITORY

import hmd

LOGS = [
    REPOSITORY / "fixtures/logs/table-iii-400hz.log",
    REPOSITORY / "fixtures/logs/random-03.mcap",
    REPOSITORY / "fixtures/logs/short-c-low-400hz.mcap",
]
STRICT = "[health]\nwatch = 0.03\nwarning = 0.05\n[identification]\nevaluations_max = 300\n"


def command(program: str, *words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([program, "replay", *words], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("log", LOGS, ids=lambda log: log.name)
@pytest.mark.parametrize("seed", [1, 12345])
@pytest.mark.parametrize("configured", [False, True])
def test_the_lines_are_those_of_the_program(
    program: str, tmp_path: Path, log: Path, seed: int, configured: bool
) -> None:
    config, options = None, []
    if configured:
        config = tmp_path / "hmd.toml"
        config.write_text(STRICT)
        options = ["-c", str(config)]
    ended = command(program, log, "--json", "--seed", str(seed), *options)
    assert ended.returncode == 0, ended.stderr
    for threads in (1, 3):
        assessed = hmd.replay(log, config=config, seed=seed, threads=threads)
        assert "".join(f"{line}\n" for line in assessed.lines) == ended.stdout
        assert assessed.loss is None
    assert [json.loads(line) for line in ended.stdout.splitlines()] == assessed.windows


def test_another_seed_or_configuration_gives_another_result(tmp_path: Path) -> None:
    config = tmp_path / "hmd.toml"
    config.write_text(STRICT)
    results = [hmd.replay(LOGS[0], seed=1), hmd.replay(LOGS[0], seed=2), hmd.replay(LOGS[0], config=config)]
    assert len({tuple(assessed.lines) for assessed in results}) == 3


def test_the_table_holds_the_same_numbers_for_pandas(worn: Path, tmp_path: Path) -> None:
    config = tmp_path / "hmd.toml"
    config.write_text(EXACT)
    assessed = hmd.replay(worn, config=config)
    frame: pandas.DataFrame = assessed.to_arrow().to_pandas()
    assert len(frame) == len(assessed.windows) == 2
    for (_, row), window in zip(frame.iterrows(), assessed.windows, strict=True):
        assert row["t_start_ns"].value == window["t_start_ns"]
        for n in range(8):
            assert row[f"k{n + 1}"] == window["k"][n]
            sigma = window["sigma"][n]
            assert math.isnan(row[f"k{n + 1}_sigma"]) if sigma is None else row[f"k{n + 1}_sigma"] == sigma
            assert bool(row[f"k{n + 1}_observable"]) == window["observable"][n]
        assert row["faults"].split(",") == window["faults"]
        assert row["damage_friction"] == window["k"][0]


def test_frames_of_pandas_and_polars_are_equal(worn: Path) -> None:
    found = hmd.replay(worn)
    of_pandas, of_polars = found.to_pandas(), found.to_polars()
    assert list(of_pandas.columns) == of_polars.columns
    pandas.testing.assert_frame_equal(of_polars.to_pandas(), of_pandas)
    assert of_polars.equals(polars.from_pandas(of_pandas))
    assert of_polars.schema["window"] == polars.Int64
    assert of_polars.schema["t_start_ns"] == polars.Datetime("ns", "UTC")


def test_windows_are_a_sequence_that_shows_itself(worn: Path) -> None:
    found = hmd.replay(worn)
    assert len(found) == len(list(found)) == len(found.windows) == 2
    assert [window["window"] for window in found] == [0, 1]
    assert {window["health"] for window in found} == {"watch"}
    assert repr(found) == "<hmd.Judged, 2 windows: 2 of ema0 watch>"
    assert found[1] == found.windows[1]
    assert found[:1] == found.windows[:1]
    again = pickle.loads(pickle.dumps(found))
    assert again == found
    assert again.to_arrow().equals(found.to_arrow())
    assert hmd.FAULT_PARAMETERS[0] == "friction"
    assert len(hmd.FAULT_PARAMETERS) == len(found.windows[0]["k"]) == 8


def test_an_error_is_the_sentence_of_the_program(program: str, tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("[window]\nduration_ms = -3\n")
    lost = tmp_path / "lost.toml"
    lost.write_text('[type.bench]\ncalibration = "none.toml"\n')
    empty = tmp_path / "empty.log"
    empty.write_text("")
    other = tmp_path / "other.log"
    other.write_text("(1700000000.000000) can0 7FF#00\n")
    half = tmp_path / "half.log"
    half.write_text("(1700000000.000000) can0 100#0000000000000000\n")
    cases: list[tuple[type[hmd.Error], int, Path, Path | None]] = [
        (hmd.ConfigError, 78, LOGS[0], bad),
        (hmd.ConfigError, 78, LOGS[0], lost),
        (hmd.ConfigError, 78, LOGS[0], tmp_path / "missing.toml"),
        (hmd.Error, 1, tmp_path / "missing.log", None),
        (hmd.Error, 1, empty, None),
        (hmd.Error, 1, other, None),
        (hmd.Error, 1, half, None),
    ]
    for kind, code, log, config in cases:
        ended = command(program, log, "--json", *(["-c", config] if config else []))
        with pytest.raises(hmd.Error) as caught:
            hmd.replay(log, config=config)
        assert (ended.returncode, type(caught.value)) == (code, kind), ended.stderr
        assert ended.stderr.splitlines()[-1] == f"hmd: {caught.value}"


def test_losses_are_reported_and_the_rest_is_assessed(program: str, worn: Path, tmp_path: Path) -> None:
    lines = worn.read_text().splitlines(keepends=True)
    lines[3000] = "this is no frame\n"
    torn = tmp_path / "torn.log"
    torn.write_text("".join(lines))
    ended = command(program, torn, "--json")
    with pytest.warns(hmd.DataLossWarning, match=r"torn\.log"):
        assessed = hmd.replay(torn)
    assert repr(assessed).endswith(", data lost>")
    assert ended.returncode == 3
    assert assessed.loss is not None
    assert f"{torn}: {assessed.loss}" in ended.stderr
    assert all(notice in ended.stderr for notice in assessed.notices)
    assert ended.stdout.splitlines() == assessed.lines


def test_what_was_not_assessed_is_observable_nowhere(worn: Path, tmp_path: Path) -> None:
    lines = worn.read_text().splitlines(keepends=True)
    torn = tmp_path / "torn.log"
    torn.write_text("".join(lines[: len(lines) // 3] + lines[len(lines) // 3 + 100 :]))
    with pytest.warns(hmd.DataLossWarning):
        found = hmd.replay(torn, output=tmp_path / "torn.mcap")
    assert "invalid" in {window["status"] for window in found}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hmd.DataLossWarning)
        stored = hmd.read_records(tmp_path / "torn.mcap")
    for table in (found.to_arrow(), stored):
        for n in range(8):
            expected = [window["observable"] and window["observable"][n] for window in found]
            assert table[f"k{n + 1}_observable"].to_pylist() == expected


def test_logs_come_in_an_order(worn: Path, tmp_path: Path) -> None:
    for function in (hmd.replay, hmd.read_raw):
        with pytest.raises(hmd.UsageError, match="logs: expected paths in the order of time, found a set"):
            function({worn})
        assert len(function(path for path in [worn])) > 0
    recorded = tmp_path / "worn.mcap"
    hmd.replay(worn, output=recorded)
    assert hmd.read_records({recorded}).num_rows == 2


def test_other_threads_go_on_meanwhile() -> None:
    beats, done = [], threading.Event()

    def beat() -> None:
        while not done.wait(0.005):
            beats.append(time.monotonic())

    other = threading.Thread(target=beat)
    other.start()
    started = time.monotonic()
    hmd.replay(LOGS[1], threads=1)
    ended = time.monotonic()
    done.set()
    other.join()
    during = [beat for beat in beats if started < beat < ended]
    assert len(during) > 0.1 * (ended - started) / 0.005

"""`hmd.replay` is `hmd replay --json`, to the last bit."""

import json
import math
import pickle
import re
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
    # A seed is drawn from by a population only.
    searches, strict = tmp_path / "searches.toml", tmp_path / "strict.toml"
    searches.write_text('[identification]\nmethod = "ga"\n')
    strict.write_text(STRICT)
    of_seeds = [hmd.replay(LOGS[0], config=searches, seed=seed) for seed in (1, 2)]
    results = [*of_seeds, hmd.replay(LOGS[0]), hmd.replay(LOGS[0], config=strict)]
    assert len({tuple(assessed.lines) for assessed in results}) == 4


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
    pandas.testing.assert_frame_equal(of_polars.to_pandas().astype(of_pandas.dtypes), of_pandas)
    assert of_polars.equals(polars.from_pandas(of_pandas))
    assert of_polars.schema["window"] == polars.Int64
    assert of_polars.schema["t_start_ns"] == polars.Datetime("ns", "UTC")


def test_windows_are_a_sequence_that_shows_itself(worn: Path) -> None:
    found = hmd.replay(worn)
    assert len(found) == len(list(found)) == len(found.windows) == 2
    assert [window["window"] for window in found] == [0, 1]
    # The friction of 0.4 is within what a type's tolerances explain: too uncertain to be named in the first window.
    assert [window["health"] for window in found] == ["watch", "warning"]
    assert repr(found) == "<hmd.Judged, 2 windows: 1 of ema0 watch, 1 of ema0 warning>"
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


def test_a_column_has_one_type_in_pandas_whatever_its_rows_hold(worn: Path, tmp_path: Path) -> None:
    lines = worn.read_text().splitlines(keepends=True)
    torn, none = tmp_path / "torn.log", tmp_path / "none.log"
    torn.write_text("".join(lines[: len(lines) // 3] + lines[len(lines) // 3 + 100 :]))
    none.write_text("".join(lines[:400]))
    frames = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hmd.DataLossWarning)
        for name, log in (("whole", worn), ("torn", torn), ("none", none)):
            recorded = tmp_path / f"{name}.mcap"
            frames[name] = hmd.replay(log, output=recorded).to_pandas()
            frames[f"{name}, stored"] = hmd.read_records(recorded).to_pandas()
            hmd.export(recorded, tmp_path / f"{name}.parquet")
            frames[f"{name}, exported"] = pandas.read_parquet(tmp_path / f"{name}.parquet")
    assert "invalid" in set(frames["torn"].status)
    assert "invalid" not in set(frames["whole"].status)
    assert len(frames["none"]) == 0
    for name, frame in frames.items():
        assert frame.dtypes.equals(frames["whole"].dtypes), name
        assert str(frame.dtypes["k1_observable"]) == "boolean", name
    # Columns of the frames that were left out do no harm.
    assert (
        str(hmd.read_records(tmp_path / "torn.mcap").select(["k2_observable"]).to_pandas().dtypes.iloc[0]) == "boolean"
    )
    both = pandas.concat([frames["whole"], frames["torn"], frames["none"]], ignore_index=True)
    assert both.dtypes.equals(frames["whole"].dtypes)
    assert both[both.k1_observable].status.isin(["ok", "degraded"]).all()
    assert polars.from_pandas(both).schema["k1_observable"] == polars.Boolean


def test_a_csv_file_is_the_same_frame_by_the_recipe_of_the_docs(
    worn: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (REPOSITORY / "docs/records.md").read_text()
    [recipe] = re.findall(r"```python\n(import json\n.*?)```", page, re.DOTALL)
    lines = worn.read_text().splitlines(keepends=True)
    torn, config = tmp_path / "torn.log", tmp_path / "hmd.toml"
    torn.write_text("".join(lines[: len(lines) // 3] + lines[len(lines) // 3 + 100 :]))
    config.write_text('[[actuator]]\nid = 0\nserial_number = "0042"\n')
    monkeypatch.chdir(tmp_path)
    for log in (worn, torn):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hmd.DataLossWarning)
            hmd.replay(log, config=config, output="out.mcap")
        hmd.export("out.mcap", "out.csv")
        found: dict[str, pandas.DataFrame] = {}
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            exec(recipe, found)
        pandas.testing.assert_frame_equal(found["frame"], hmd.read_records("out.mcap").to_pandas())


def test_rows_say_which_log_they_are_of(worn: Path, tmp_path: Path) -> None:
    days = tmp_path / "days"
    days.mkdir()
    for day in range(3):
        text = re.sub(r"\((\d+)", lambda found, day=day: f"({int(found[1]) + 86_400 * day}", worn.read_text())
        (days / f"day-{day}.log").write_text(text)
    recorded = tmp_path / "recorded.mcap"
    found = hmd.replay(days, output=recorded).to_pandas()
    assert list(found.file) == [f"day-{day}.log" for day in range(3) for _ in range(2)]
    first_ns = {f"day-{day}.log": pandas.Timestamp(2023, 11, 14 + day, tz="UTC") for day in range(3)}
    assert all(0 <= (row.t_start_ns - first_ns[row.file]).days < 1 for row in found.itertuples())
    # Of the recording they are of the recording; the start of a window joins them.
    stored = hmd.read_records(recorded).to_pandas()
    assert set(stored.file) == {"recorded.mcap"}
    joined = stored.merge(found, on=["actuator", "t_start_ns"], validate="one_to_one")
    assert len(joined) == len(found)
    raw = hmd.read_raw(days).to_pandas()
    assert list(raw.file.unique()) == list(found.file.unique())
    assert not raw.duplicated(["file", "actuator", "seq"]).any()
    # Of equal names by their paths.
    (tmp_path / "other").mkdir()
    other = tmp_path / "other/day-0.log"
    other.write_bytes((days / "day-2.log").read_bytes())
    both = hmd.replay([days / "day-0.log", other]).to_pandas()
    assert list(both.file.unique()) == [str(days / "day-0.log"), str(other)]


def test_a_log_that_goes_on_in_the_next_has_the_window_that_began_in_it(worn: Path, tmp_path: Path) -> None:
    units = tmp_path / "unit"
    units.mkdir()
    lines = worn.read_text().splitlines(keepends=True)
    (units / "a.log").write_text("".join(lines[: 3 * len(lines) // 4]))
    (units / "b.log").write_text("".join(lines[3 * len(lines) // 4 :]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hmd.DataLossWarning)
        found = hmd.replay(units).to_pandas()
        raw = hmd.read_raw(units).to_pandas()
    for row in found.itertuples():
        assert row.file == raw[raw.t_ns == row.t_start_ns].file.iloc[0]


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

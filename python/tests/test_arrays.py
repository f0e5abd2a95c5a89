"""Tables of logs and records, samples in arrays, and the simulation."""

import json
import math
import subprocess
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pyarrow.parquet as pq
import pytest
from conftest import REPOSITORY

import hmd

MAPPED = REPOSITORY / "fixtures/logs/eccentricity-medium-400hz.log"


def arrays(log: Path, **options: Any) -> dict[str, Any]:
    """The samples of a log as `identify` takes them."""
    table = hmd.read_raw(log, **options)
    column = {name: table[name].to_numpy() for name in table.column_names}
    return {
        "currents_a": np.column_stack([column["i_a_a"], column["i_b_a"], column["i_c_a"]]),
        "motor_counts": column["motor_counts"],
        "output_counts": column["output_counts"],
        "setpoint": column["setpoint"],
        "mode": column["mode"],
        "rate_hz": column["sample_rate_hz"][0],
        "seq": column["seq"],
        "t_ns": column["t_ns"].astype(np.int64),
        "dc_link_v": column["dc_link_v"][-1],
        "winding_temp_c": column["winding_temp_c"][-1],
        "load_torque_nm": column["load_torque_nm"][-1],
    }


@pytest.mark.parametrize("log", ["worn", MAPPED], ids=str)
def test_samples_in_arrays_give_what_their_log_gives(log: Path | str, worn: Path) -> None:
    path = worn if log == "worn" else Path(log)
    found = hmd.identify(**arrays(path), seed=3)
    assert found.lines == hmd.replay(path, seed=3).lines
    assert found.lines


def test_plain_arrays_are_enough(worn: Path) -> None:
    samples = arrays(worn)
    for name in ("seq", "t_ns", "dc_link_v", "winding_temp_c", "load_torque_nm"):
        del samples[name]
    samples["mode"] = "position"
    samples["motor_counts"] = samples["motor_counts"].astype(float)
    # Only the first of the two actuations is one of the position loop.
    moved = len(samples["setpoint"]) // 2
    first = {name: value[:moved] if isinstance(value, np.ndarray) else value for name, value in samples.items()}
    windows = hmd.identify(**first).windows
    assert [window["status"] for window in windows] in (["ok"], ["degraded"])
    (window,) = windows
    assert window["k"][0] == pytest.approx(0.4, abs=0.05)
    assert window["k"][3] == pytest.approx(0.15, abs=0.05)
    assert 0 < window["evaluations"] < 10_000
    assert window["cost"] > 0
    assert window["observable"][3] is True


def test_rest_is_no_actuation_and_bad_data_are_no_fault(worn: Path) -> None:
    samples = arrays(worn)
    still = {name: value[:150] if isinstance(value, np.ndarray) else value for name, value in samples.items()}
    assert hmd.identify(**still).lines == []
    nothing = {name: value[:0] if isinstance(value, np.ndarray) else value for name, value in samples.items()}
    assert hmd.identify(**nothing).lines == []
    samples["currents_a"] = np.full_like(samples["currents_a"], np.nan)
    for window in hmd.identify(**samples).windows:
        assert (window["status"], window["k"], window["faults"]) == ("invalid", None, [])


def test_arrays_that_make_no_sense_are_refused(worn: Path) -> None:
    samples = arrays(worn)
    cases: list[tuple[dict[str, Any], str]] = [
        ({"currents_a": samples["currents_a"][:, :2]}, "currents_a: expected the shape (n, 3), found (1000, 2)"),
        ({"setpoint": samples["setpoint"][:-1]}, "columns: expected 1000 values in each, found 999"),
        ({"mode": "fast"}, "mode: expected idle, position or speed, found 'fast'"),
        (
            {"motor_counts": samples["motor_counts"] + 0.5},
            "motor_counts: expected whole numbers, found a fraction or none",
        ),
        ({"seq": samples["seq"].astype(np.int64) - 2**40}, "seq[0]: expected a number from 0, found"),
        ({"actuator": "nobody"}, 'actuator: expected one of the configuration, found "nobody"'),
    ]
    n = len(samples["setpoint"])
    for change, text in cases:
        with pytest.raises(hmd.UsageError) as caught:
            hmd.identify(**{**samples, **change})
        assert str(caught.value).replace(str(n), "1000").replace(str(n - 1), "999").startswith(text)
    later = samples["t_ns"].astype("datetime64[ns]")
    assert hmd.identify(**{**samples, "t_ns": later}) == hmd.identify(**samples)
    cases = [
        ({"rate_hz": math.nan}, "rate_hz: expected a number above 0, found nan"),
        ({"rate_hz": 0}, "rate_hz: expected a number above 0, found 0"),
        ({"t_ns": samples["t_ns"][::-1]}, "t_ns: expected values that rise"),
        ({"seq": np.zeros(n, dtype=np.int64)}, "seq: expected values that rise"),
        ({"load_torque_nm": samples["setpoint"]}, "load_torque_nm: expected a number, found ndarray"),
        ({"motor_counts": np.full(n, 2**64 - 1, dtype=np.uint64)}, "motor_counts: expected whole numbers below 2⁶³"),
        ({"rate_hz": None}, "rate_hz: expected a number, found NoneType"),
        ({"actuator": 0}, "identify: expected other arguments"),
        ({"threads": 0}, "threads: expected a whole number from 1 to 1024, found 0"),
        ({"seed": -1}, "seed: expected a whole number from 0"),
        ({"config": b"hmd.toml"}, "config: expected a path as text or pathlib.Path, found b'hmd.toml'"),
    ]
    for change, text in cases:
        with pytest.raises(hmd.UsageError) as caught:
            hmd.identify(**{**samples, **change})
        assert str(caught.value).startswith(text)


def test_raw_samples_have_units_and_go_to_polars(worn: Path) -> None:
    table = hmd.read_raw(worn)
    units = {field.name: (field.metadata or {}).get(b"unit") for field in table.schema}
    assert (units["i_a_a"], units["sample_rate_hz"], units["motor_counts"]) == (b"A", b"Hz", None)
    frame = polars.DataFrame(polars.from_arrow(table))
    assert frame["t_ns"].dtype == polars.Datetime("ns", "UTC")
    assert set(frame["actuator"]) == {"ema0"}
    assert frame["seq"].diff().drop_nulls().unique().to_list() == [1]
    currents = frame.select(polars.sum_horizontal("i_a_a", "i_b_a", "i_c_a").abs().max()).item()
    # Three currents without a way out sum to zero; each has 30 mA of noise and a converter of 12 bits.
    assert currents < 0.4
    assert frame["sample_rate_hz"].unique().to_list() == [400.0]


def test_records_are_those_of_the_export(program: str, worn: Path, tmp_path: Path) -> None:
    recorded = tmp_path / "worn.mcap"
    assessed = hmd.replay(worn, output=recorded)
    for kind in ("health", "samples"):
        exported = tmp_path / f"{kind}.parquet"
        subprocess.run([program, "export", recorded, "--table", kind, "-o", exported], check=True)
        table = hmd.read_records(recorded, kind)
        expected = pq.read_table(exported)
        assert table.column_names == expected.column_names
        assert table.num_rows == expected.num_rows > 0
        assert table.schema.types == expected.schema.types
        assert table.to_pylist() == expected.to_pylist()
        units = json.loads(pq.read_metadata(exported).metadata[b"units"])
        assert {f.name: f.metadata[b"unit"].decode() for f in table.schema if f.metadata} == units
        for key in (b"units", b"pandas"):
            assert json.loads(table.schema.metadata[key]) == json.loads(expected.schema.metadata[key])
    of_log = assessed.to_arrow()
    assert set(of_log["file"].to_pylist()) == {"worn.log"}
    assert hmd.read_records(recorded).drop_columns("file").equals(of_log.drop_columns("file"))


def test_damage_is_warned_of(worn: Path, tmp_path: Path) -> None:
    torn = tmp_path / "torn.log"
    torn.write_text(worn.read_text() + "no frame\n")
    with pytest.warns(hmd.DataLossWarning) as told:
        rows = hmd.read_raw(torn)
    [warning] = told
    line = len(torn.read_text().splitlines())
    assert str(warning.message).startswith(f"{torn}:{line}: expected ")
    assert str(warning.message).endswith(f"; {torn}: data lost: 1 unreadable line or frame")
    recorded = tmp_path / "recorded.mcap"
    hmd.replay(worn, output=recorded)
    recorded.write_bytes(recorded.read_bytes()[:-4000])
    with pytest.warns(hmd.DataLossWarning) as told:
        hmd.read_records(recorded)
    with pytest.warns(hmd.DataLossWarning) as of_export:
        hmd.export(recorded, tmp_path / "recorded.csv")
    assert [str(warning.message) for warning in told] == [str(warning.message) for warning in of_export]
    assert f"{recorded}: at byte " in str(told[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert rows.drop_columns("file").equals(hmd.read_raw(worn).drop_columns("file"))
    with pytest.raises(hmd.Error, match=r"missing\.mcap"):
        hmd.read_records(tmp_path / "missing.mcap")
    with pytest.raises(hmd.Error, match=r"worn\.log: expected records of windows, found none"):
        hmd.read_records(worn)
    with pytest.raises(hmd.UsageError, match="files: expected a file or folder, found none"):
        hmd.read_records([])


def test_a_file_without_records_says_why_as_the_export_does(worn: Path, tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    hmd.replay(worn, output=whole)
    frames = tmp_path / "frames.mcap"
    hmd.simulate(frames, rate_hz=400)
    cut, empty, text = (tmp_path / f"{name}.mcap" for name in ("cut", "empty", "text"))
    cut.write_bytes(whole.read_bytes()[:8000])
    empty.write_bytes(b"")
    text.write_text("t,i_a\n0.0,1.5\n")
    for file, why in (
        (cut, "at byte [0-9]+: expected a record, found the end of the file: it was cut or never finished"),
        (empty, "at byte 0: expected an MCAP file, found an empty file"),
        (text, "at byte 0: expected the start of an MCAP file, found"),
        (frames, "it has frames alone"),
    ):
        expected = rf"{file.name}: expected records of windows, found none: {why}"
        with pytest.raises(hmd.Error, match=expected) as caught:
            hmd.read_records(file)
        with pytest.raises(hmd.Error, match=expected) as by_export:
            hmd.export(file, tmp_path / "out.csv")
        assert str(by_export.value) == str(caught.value)


def test_a_recording_without_an_actuation_is_a_table_without_rows(worn: Path, tmp_path: Path) -> None:
    idle, recorded = tmp_path / "idle.log", tmp_path / "idle.mcap"
    idle.write_text("".join(worn.read_text().splitlines(keepends=True)[:400]))
    assessed = hmd.replay(idle, output=recorded)
    assert len(assessed) == 0
    table = hmd.read_records(recorded)
    assert table.equals(assessed.to_arrow())
    assert table.schema.metadata == assessed.to_arrow().schema.metadata
    for name in ("idle.parquet", "idle.csv"):
        hmd.export(recorded, tmp_path / name)
    exported = pq.read_table(tmp_path / "idle.parquet")
    assert (exported.num_rows, exported.schema.names, exported.schema.types) == (
        0,
        table.schema.names,
        table.schema.types,
    )
    assert (tmp_path / "idle.csv").read_text().strip() == ",".join(table.column_names)

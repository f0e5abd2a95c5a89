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
    assert window["observable"][0] is True


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
        ({"seq": -samples["seq"].astype(np.int64)}, "seq[0]: expected a number from 0, found"),
        ({"actuator": "nobody"}, 'actuator: expected one of the configuration, found "nobody"'),
    ]
    n = len(samples["setpoint"])
    for change, text in cases:
        with pytest.raises(hmd.UsageError) as caught:
            hmd.identify(**{**samples, **change})
        assert str(caught.value).replace(str(n), "1000").replace(str(n - 1), "999").startswith(text)
    # No windower for such a rate: reported, not assessed.
    assessed = hmd.identify(**{**samples, "rate_hz": math.nan})
    assert assessed.lines == []
    assert "not monitored" in assessed.notices[0]


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
        # Parquet spells counts as signed numbers.
        assert table.cast(expected.schema, safe=True).to_pylist() == expected.to_pylist()
        units = json.loads(pq.read_metadata(exported).metadata[b"units"])
        assert {f.name: f.metadata[b"unit"].decode() for f in table.schema if f.metadata} == units
    assert hmd.read_records(recorded).equals(assessed.to_arrow())


def test_damage_is_warned_of(worn: Path, tmp_path: Path) -> None:
    torn = tmp_path / "torn.log"
    torn.write_text(worn.read_text() + "no frame\n")
    with pytest.warns(hmd.DataLossWarning, match=r"torn\.log"):
        rows = hmd.read_raw(torn)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert rows.equals(hmd.read_raw(worn))
    with pytest.raises(hmd.Error, match=r"missing\.mcap"):
        hmd.read_records(tmp_path / "missing.mcap")


def test_a_simulation_is_that_of_the_program(program: str, tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours.mcap", tmp_path / "theirs.mcap"
    hmd.simulate(ours, k=[0.1, 0, 0, 0, 0, 0, 0.5, 0.5], faults={"gain": 0.7}, rate_hz=400, load_nm=-5, seed=4)
    words = "--k 0.1,0,0,0,0,0,0.5,0.5 --fault gain=0.7 --rate 400 --load -5 --seed 4".split()
    subprocess.run([program, "simulate", "-o", theirs, *words], check=True)
    assert ours.read_bytes() == theirs.read_bytes()
    truth = Path(f"{ours}.truth.jsonl").read_text()
    assert json.loads(truth)["k"] == [0.1, 0, 0, 0, 0, 0, 0.5, 0.7]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"windows": 0}, "invalid value '0' for '--windows <WINDOWS>': 0 is not in 1..=100000"),
        ({"faults": {"rust": 1.0}}, "invalid value 'rust=1.0' for '--fault <NAME=K>': expected one of friction"),
        ({"noise_a": math.nan}, "invalid value 'nan' for '--noise <NOISE>': expected a number"),
        ({"rate_hz": 5000}, "--rate: expected at most 90 % of a 1 Mbit/s bus"),
        ({"k": [2.0] * 8}, "friction: expected a number from 0 to 1, found 2"),
        ({"actuator": "none"}, "--actuator: expected bench, servo28, servo270 or a type of the configuration"),
    ],
)
def test_a_simulation_that_cannot_be_is_refused(tmp_path: Path, options: dict[str, Any], text: str) -> None:
    with pytest.raises(hmd.UsageError) as caught:
        hmd.simulate(tmp_path / "no.log", **options)
    assert str(caught.value).startswith(text)
    assert len(str(caught.value).splitlines()) == 1
    assert not (tmp_path / "no.log").exists()

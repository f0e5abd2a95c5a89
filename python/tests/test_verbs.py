"""The verbs that write files are those of the program, to the last byte."""

import json
import math
import subprocess
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

import hmd


def command(program: str, *words: str | Path, code: int = 0) -> subprocess.CompletedProcess[str]:
    ended = subprocess.run([program, *words], capture_output=True, text=True, check=False)
    assert ended.returncode == code, ended.stderr
    return ended


@pytest.fixture(scope="module")
def recorded(worn: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a replay records of a worn actuator."""
    path = tmp_path_factory.mktemp("recorded") / "worn.mcap"
    hmd.replay(worn, output=path)
    return path


@pytest.fixture(scope="module")
def torn(recorded: Path) -> Path:
    """The same without its end."""
    path = recorded.with_name("torn.mcap")
    path.write_bytes(recorded.read_bytes()[:-4000])
    return path


def test_a_unit_is_commissioned_as_by_the_program(program: str, tmp_path: Path) -> None:
    healthy = tmp_path / "healthy"
    healthy.mkdir()
    hmd.simulate(healthy / "a.log", windows=3, rate_hz=400, noise_a=0.03, seed=6)
    hmd.simulate(healthy / "b.log", windows=4, rate_hz=400, noise_a=0.03, seed=7)
    ours, theirs = tmp_path / "ours.toml", tmp_path / "theirs.toml"
    ended = command(program, "calibrate", healthy, "-o", theirs, "--seed", "2")
    # Again and again, on other threads.
    for threads in (1, None):
        said = hmd.calibrate(healthy, ours, report=tmp_path / "ours.html", seed=2, threads=threads)
        assert said == ended.stderr.splitlines()
        assert ours.read_bytes() == theirs.read_bytes()
    assert any("smallest damage that shows" in line for line in said)
    assert "<svg" in (tmp_path / "ours.html").read_text()
    with pytest.raises(hmd.Error, match="expected at least 5 windows"):
        hmd.calibrate(healthy / "a.log", ours)
    with pytest.raises(hmd.Error, match='--name: expected one of ema0, found "zz"'):
        hmd.calibrate(healthy, ours, name="zz")
    config = tmp_path / "hmd.toml"
    config.write_text(
        f'[[actuator]]\nid = 0\ncalibration = "{ours.name}"\n[type.bench.transmission]\ngear_ratio = 201.0\n'
    )
    assert "parameters of type bench have changed" in hmd.replay(healthy / "a.log", config=config).notices[0]


def test_a_configuration_means_what_the_program_says(program: str, tmp_path: Path) -> None:
    assert hmd.check_config() == json.loads(command(program, "check-config", "--json").stdout)
    config = tmp_path / "hmd.toml"
    config.write_text("[health]\nwatch = 0.04\n")
    assert hmd.check_config(config)["config"]["health"]["friction"]["watch"] == 0.04
    config.write_text("[health]\nwatch = 2\n")
    ended = command(program, "check-config", config, code=78)
    with pytest.raises(hmd.ConfigError) as caught:
        hmd.check_config(config)
    assert ended.stderr == f"hmd: {caught.value}\n"


def test_pages_and_tables_are_those_of_the_program(program: str, recorded: Path, torn: Path, tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours.html", tmp_path / "theirs.html"
    hmd.report(recorded, ours, zone="UTC", actuator="ema0")
    command(program, "report", recorded, "-o", theirs, "--zone", "UTC", "--actuator", "ema0")
    assert ours.read_bytes() == theirs.read_bytes()
    for name in ("health.csv", "samples.parquet"):
        kind: Any = name.split(".")[0]
        hmd.export(recorded, tmp_path / f"ours-{name}", table=kind)
        command(program, "export", recorded, "-o", tmp_path / f"theirs-{name}", "--table", kind)
        assert (tmp_path / f"ours-{name}").read_bytes() == (tmp_path / f"theirs-{name}").read_bytes()
    for verb, output in ((hmd.report, ours), (hmd.export, tmp_path / "torn.csv")):
        with pytest.warns(hmd.DataLossWarning, match=r"torn\.mcap.*data lost"):
            verb(torn, output)


def test_what_is_no_recording_is_refused(program: str, tmp_path: Path) -> None:
    text = tmp_path / "-text.mcap"
    text.write_text("no recording")
    for verb, output in ((hmd.report, tmp_path / "page.html"), (hmd.export, tmp_path / "table.csv")):
        with pytest.raises(hmd.Error, match=r"-text\.mcap"):
            verb(text, output)
        with pytest.raises(hmd.UsageError, match="files: expected a file or folder, found none"):
            verb([], output)
        assert not output.exists()
    with pytest.raises(hmd.UsageError, match=r"expected a name that ends in \.csv or \.parquet"):
        hmd.export(text, tmp_path / "table.txt")
    with pytest.raises(hmd.UsageError, match=r"expected a name that ends in \.html"):
        hmd.report(text, tmp_path / "page.toml")
    with pytest.raises(hmd.UsageError, match=r"expected a name that ends in \.mcap"):
        hmd.replay(text, output=tmp_path / "samples.csv")
    with pytest.raises(hmd.UsageError, match="config: expected a path"):
        hmd.check_config(3)  # type: ignore[arg-type]


def test_a_simulation_is_that_of_the_program(program: str, tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours.mcap", tmp_path / "theirs.mcap"
    hmd.simulate(ours, k=[0.1, 0, 0, 0, 0, 0, 0.5, 0.5], faults={"gain": 0.7}, rate_hz=400, load_nm=-5, seed=4)
    words = "--k 0.1,0,0,0,0,0,0.5,0.5 --fault gain=0.7 --rate 400 --load -5 --seed 4".split()
    command(program, "simulate", "-o", theirs, *words)
    assert ours.read_bytes() == theirs.read_bytes()
    truth = Path(f"{ours}.truth.jsonl").read_text()
    assert json.loads(truth)["k"] == [0.1, 0, 0, 0, 0, 0, 0.5, 0.7]

    hmd.simulate(ours, mode="speed", profile="step", preset="odrive", output_encoder=True, id=3, seed=4, rate_hz=400)
    words = "--mode speed --profile step --preset odrive --output-encoder --id 3 --seed 4 --rate 400".split()
    command(program, "simulate", "-o", theirs, *words)
    assert ours.read_bytes() == theirs.read_bytes()

    start = datetime(2026, 11, 20, 14, tzinfo=UTC)
    hmd.simulate(ours, effects={"dead_time_s": 1.5e-6, "cogging_nm": 0.05}, drive="vector", start=start)
    words = "--with dead_time_s=1.5e-6 --with cogging_nm=0.05 --drive vector --start 2026-11-20T15:00+01:00".split()
    command(program, "simulate", "-o", theirs, *words)
    assert ours.read_bytes() == theirs.read_bytes()
    [window] = hmd.replay(ours).windows
    assert window["t_start_ns"] // 10**9 == start.timestamp()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"windows": 0}, "invalid value '0' for '--windows <WINDOWS>': 0 is not in 1..=100000"),
        ({"faults": {"rust": 1.0}}, "invalid value 'rust=1.0' for '--fault <NAME=K>': expected one of friction"),
        ({"noise_a": math.nan}, "invalid value 'nan' for '--noise <NOISE>': expected a number"),
        ({"rate_hz": 5000}, "--rate: expected at most 90 % of a 1 Mbit/s bus"),
        ({"effects": {"rust": 1.0}}, "invalid value 'rust=1.0' for '--with <EFFECT=VALUE>'"),
        ({"start": datetime(2026, 11, 20)}, "start: expected a datetime with a time zone, found datetime"),
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

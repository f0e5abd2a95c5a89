"""The fleet's contract, and a folder of logs on a Dask cluster with a worker killed on the way."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from html import escape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from conftest import EXACT, REPOSITORY
from pyarrow import csv

import hmd
from hmd.fleet import Job, cluster, contract, find_logs, one_log
from hmd.fleet.__main__ import run
from hmd.fleet.statistics import outliers, rarely_assessed, read_units, trends, worst

UNITS, DAYS = 6, 10
DAY_S = 86_400


def shifted(log: Path, text: str, seconds: int) -> None:
    """The same actuation at another time."""
    log.parent.mkdir(parents=True, exist_ok=True)
    log.write_text(re.sub(r"\((\d+)", lambda found: f"({int(found[1]) + seconds}", text))


@pytest.fixture(scope="session")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sixty logs of six units, one a day; the friction of one unit grows. And three that are none."""
    folder = tmp_path_factory.mktemp("fleet")
    made = tmp_path_factory.mktemp("made") / "one.log"
    for unit in range(UNITS):
        texts: dict[float, str] = {}
        for day in range(DAYS):
            friction = 0.05 + 0.04 * day if unit == 2 else 0.1
            if friction not in texts:
                hmd.simulate(made, faults={"friction": friction}, rate_hz=400, seed=unit + 1)
                texts[friction] = made.read_text()
            shifted(folder / f"unit-{unit}/day-{day:02}.log", texts[friction], day * DAY_S)
    return folder


@pytest.fixture
def spoilt(fleet: Path, tmp_path: Path) -> Path:
    """The fleet with a log that is none, one with a bad line, and one twice."""
    folder = tmp_path / "spoilt"
    for log in sorted(fleet.rglob("*.log"))[:4]:
        place = folder / log.relative_to(fleet)
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(log.read_bytes())
    (folder / "empty.log").write_text("")
    (folder / "bad.mcap").write_bytes(b"no MCAP at all")
    lines = (folder / "unit-0/day-01.log").read_text().splitlines(keepends=True)
    (folder / "torn.log").write_text("".join([*lines, "no frame\n"]))
    (folder / "zz-copy.log").write_bytes((folder / "unit-0/day-00.log").read_bytes())
    return folder


def results(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(out.glob("results/*/*"))}


def test_a_result_is_the_replay_and_is_named_by_what_it_is_made_of(fleet: Path, program: str, tmp_path: Path) -> None:
    log = fleet / "unit-2/day-03.log"
    job = Job.prepared(tmp_path / "out", None, 1)
    outcome = one_log(log, job)
    assert outcome.computed
    head, *lines = job.result(outcome.key).read_text().splitlines()
    replayed = subprocess.run([program, "replay", log, "--json"], capture_output=True, text=True, check=True)
    assert lines == replayed.stdout.splitlines()
    assert json.loads(head)["exit"] == 0
    again = one_log(log, job)
    assert (again.key, again.computed) == (outcome.key, False)

    config = tmp_path / "hmd.toml"
    config.write_text("[window]\nduration_ms = 300\n")
    others = [Job.prepared(tmp_path / "out", None, 2), Job.prepared(tmp_path / "out", config, 1)]
    keys = {outcome.key, *(other.key(outcome.content) for other in others), job.key("other bytes")}
    assert len(keys) == 4
    config.write_text("# the same, written otherwise\n[window]\nduration_ms = 300.0\n")
    assert Job.prepared(tmp_path / "out", config, 1).identity == others[1].identity


def test_what_the_configuration_names_is_a_part_of_the_name(fleet: Path, tmp_path: Path) -> None:
    config, events = tmp_path / "hmd.toml", tmp_path / "events.jsonl"
    config.write_text(f'[rul]\nevents = "{events}"\n')
    without = Job.prepared(tmp_path / "out", config, 1).identity
    events.write_text("")
    assert Job.prepared(tmp_path / "out", config, 1).identity != without


def test_a_result_is_whole_or_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "results/ab/abc.jsonl"
    contract.write_whole(place, "first\n")

    def cut(_: int) -> None:
        raise OSError("the disk is full")

    monkeypatch.setattr(os, "fsync", cut)
    with pytest.raises(OSError, match="full"):
        contract.write_whole(place, "second\n")
    assert place.read_text() == "first\n"


def test_a_log_that_cannot_be_read_has_no_result_and_one_that_is_bad_has(tmp_path: Path) -> None:
    job = Job.prepared(tmp_path / "out", None, 1)
    missing = one_log(tmp_path / "missing.log", job)
    assert (missing.key, missing.message) == ("", "No such file or directory")
    bad = tmp_path / "bad.log"
    bad.write_text("")
    head = json.loads(job.result(one_log(bad, job).key).read_text())
    assert (head["exit"], str(tmp_path) in head["message"]) == (1, False)
    assert contract.message_of("a/b.log", head["message"]).startswith("a/b.log: expected a log of a format")
    # As results of earlier versions have it.
    assert contract.message_of("a/b.log", "log: expected a log") == "a/b.log: expected a log"
    with pytest.raises(hmd.ConfigError):
        Job.prepared(tmp_path / "out", tmp_path / "missing.toml", 1)


def test_results_lie_nowhere_among_the_logs(fleet: Path, tmp_path: Path) -> None:
    out = fleet / "out"
    out.mkdir()
    (out / "no-log.log").write_text("")
    try:
        assert len(find_logs(fleet, Job.prepared(out, None, 1)).logs) == UNITS * DAYS
    finally:
        (out / "no-log.log").unlink()
        out.rmdir()


def test_a_killed_worker_changes_nothing_and_a_second_run_does_nothing(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calm, rough = tmp_path / "calm", tmp_path / "rough"
    one_by_one = [sys.executable, "-m", "hmd.fleet.one", str(fleet), "-o", str(calm)]
    subprocess.run(one_by_one, check=True)
    expected = results(calm)
    assert len(expected) == UNITS * DAYS
    killed: list[int] = []

    def kill_half_way() -> None:
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline:
            if len(list(rough.glob("results/*/*.jsonl"))) >= UNITS * DAYS // 3:
                os.kill(worker_of_this_process(), signal.SIGKILL)
                killed.append(len(list(rough.glob("results/*/*.jsonl"))))
                return
            time.sleep(0.01)

    killer = threading.Thread(target=kill_half_way)
    killer.start()
    assert run(fleet, rough, workers=2) == 0
    killer.join()
    assert killed
    assert killed[0] < UNITS * DAYS, "the worker was killed after the work"
    assert results(rough) == expected
    assert f"{UNITS * DAYS} logs" in capsys.readouterr().out
    table = pq.read_table(rough / "fleet.parquet")
    assert table.num_rows == UNITS * DAYS
    assert len(set(zip(table["log"].to_pylist(), table["window"].to_pylist(), strict=True))) == UNITS * DAYS

    # The calm results as a table: the same.
    assert run(fleet, calm, workers=2) == 0
    assert pq.read_table(calm / "fleet.parquet").equals(table)

    before = {path: path.stat().st_mtime_ns for path in rough.rglob("*") if path.is_file()}
    since = time.monotonic()
    assert run(fleet, rough, workers=2) == 0
    assert time.monotonic() - since < 2
    assert {path: path.stat().st_mtime_ns for path in rough.rglob("*") if path.is_file()} == before
    assert f" 0 assessed now, {UNITS * DAYS} were done" in capsys.readouterr().out.splitlines()[-1]


def worker_of_this_process() -> int:
    """A worker of the local cluster; its nanny lives in this process and starts another one."""
    from distributed import Nanny

    nannies = [nanny for nanny in Nanny._instances if nanny.pid is not None]
    assert nannies
    return int(nannies[0].pid)


def test_a_log_that_kills_its_worker_is_listed_and_the_others_are_assessed(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "logs"
    for n, log in enumerate(sorted(fleet.rglob("*.log"))[:10]):
        shifted(folder / f"{n}.log", log.read_text(), n)
    (folder / "3.log").rename(folder / "deadly.log")

    # Defined in here, so that it travels to the workers by value.
    def deadly(logs: list[str], job: Job) -> list[Any]:
        import os
        from pathlib import Path

        from hmd.fleet import one_log

        if any("deadly" in log for log in logs):
            os._exit(9)
        return [one_log(Path(log), job) for log in logs]

    monkeypatch.setattr(cluster, "batch", deadly)
    out = tmp_path / "out"
    assert run(folder, out, workers=2) == 3
    summary = json.loads((out / "fleet.json").read_text())
    assert summary["counts"] | {"judged": 9, "bad": 1} == summary["counts"]
    assert summary["bad"] == [{"log": "deadly.log", "message": "its worker died each time"}]


def test_each_unit_has_its_own_configuration(fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, configs, out = tmp_path / "logs", tmp_path / "configs", tmp_path / "out"
    configs.mkdir()
    with pytest.raises(hmd.ConfigError, match=r"expected configurations called UNIT\.toml, found none"):
        run(folder, out, configs, workers=0)
    own = configs / "unit-2.toml"
    own.write_text(EXACT)
    for unit in ("unit-1", "unit-2"):
        shifted(folder / unit / "day.log", (fleet / unit / "day-09.log").read_text(), 0)
    (configs / "unit-9.toml").write_text(EXACT)
    assert run(folder, out, configs, workers=1) == 0
    said = capsys.readouterr().err
    assert "folders without a configuration of their unit: unit-1" in said
    assert "configurations of no log: unit-9.toml" in said

    def lines(unit: str) -> list[str]:
        log = folder / unit / "day.log"
        texts = [text.decode() for text in results(out).values()]
        found = next(text for text in texts if contract.hash_of(log) in text.splitlines()[0])
        return found.splitlines()[1:]

    assert lines("unit-1") == hmd.replay(folder / "unit-1/day.log").lines
    assert lines("unit-2") == hmd.replay(folder / "unit-2/day.log", config=own).lines
    assert lines("unit-2") != hmd.replay(folder / "unit-2/day.log").lines
    # Another configuration of one unit: that unit alone is assessed again.
    before = set(results(out))
    own.write_text(EXACT + "[health]\nwatch = 0.04\n")
    assert run(folder, out, configs, workers=0) == 0
    assert len(set(results(out)) - before) == 1


def ended(program: str, *words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", program, *words], capture_output=True, text=True, check=False)


def test_arguments_that_make_no_sense_are_refused(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for program in ("hmd.fleet", "hmd.fleet.one"):
        for number in ("-1", str(2**64)):
            refused = ended(program, tmp_path, "-o", out, "--seed", number)
            assert (refused.returncode, "expected a whole number" in refused.stderr) == (2, True)
    refused = ended("hmd.fleet", tmp_path, "-o", out, "--workers", "-1")
    assert (refused.returncode, "expected a whole number" in refused.stderr) == (2, True)
    for name, found in (("none", "expected a folder, found none"), (__file__, "expected a folder, found a file")):
        refused = ended("hmd.fleet", tmp_path / name, "-o", out)
        assert (refused.returncode, found in refused.stderr) == (1, True)
    (tmp_path / "idle").mkdir()
    refused = ended("hmd.fleet.one", tmp_path / "idle", "-o", out)
    assert (refused.returncode, "found none" in refused.stderr) == (1, True)
    assert not out.exists()


def test_logs_without_a_window_are_a_table_without_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = tmp_path / "logs", tmp_path / "out"
    folder.mkdir()
    (folder / "bad.log").write_text("no frame\n")
    for _ in range(2):
        assert run(folder, out, workers=0) == 3
        assert "1 bad, 0 with losses, 0 windows of 0 units" in capsys.readouterr().out
        assert pq.read_table(out / "fleet.parquet").num_rows == 0


def test_outputs_of_which_one_is_of_another_run_are_made_again(fleet: Path, tmp_path: Path) -> None:
    folder, out = tmp_path / "logs/unit", tmp_path / "out"
    shifted(folder / "0.log", (fleet / "unit-0/day-00.log").read_text(), 0)
    assert run(folder.parent, out, workers=0) == 0
    before = (out / "fleet.json").read_text()
    shifted(folder / "1.log", (fleet / "unit-0/day-01.log").read_text(), 0)
    assert run(folder.parent, out, workers=0) == 0
    # As if the run had been cut behind the table.
    (out / "fleet.json").write_text(before)
    assert run(folder.parent, out, workers=0) == 0
    assert json.loads((out / "fleet.json").read_text())["counts"]["logs"] == 2
    # What is known of the logs without reading them, and a result that lost its content.
    (out / "index.jsonl").write_bytes(b"\xff\n{}\n")
    next(out.glob("results/*/*")).write_text("")
    expected = (out / "fleet.parquet").read_bytes()
    assert run(folder.parent, out, workers=0) == 0
    assert (out / "fleet.parquet").read_bytes() == expected
    assert all(results(out).values())


def test_linked_folders_are_searched_once_and_any_name_is_a_name(fleet: Path, tmp_path: Path) -> None:
    folder, elsewhere, out = tmp_path / "logs", tmp_path / "elsewhere", tmp_path / "out"
    shifted(folder / "here/0.log", (fleet / "unit-0/day-00.log").read_text(), 0)
    shifted(elsewhere / "1.log", (fleet / "unit-1/day-00.log").read_text(), 0)
    (elsewhere / "1.log").rename(Path(os.fsdecode(os.fsencode(elsewhere) + b"/Fl\xfcgel.log")))
    (folder / "there").symlink_to(elsewhere)
    (elsewhere / "round").symlink_to(folder)
    assert run(folder, out, workers=0) == 0
    table = pq.read_table(out / "fleet.parquet")
    assert table["log"].to_pylist() == ["here/0.log", "there/Fl\\xfcgel.log"]
    [passed_over] = json.loads((out / "fleet.json").read_text())["passed_over"]
    assert passed_over == {"reason": contract.LINK, "files": 1, "first": "there/round"}


def test_a_serial_number_is_that_of_the_log_else_that_of_the_configuration(fleet: Path, tmp_path: Path) -> None:
    folder, out, config = tmp_path / "logs", tmp_path / "out", tmp_path / "hmd.toml"
    log = folder / "unit/day.log"
    shifted(log, (fleet / "unit-0/day-00.log").read_text(), 0)
    config.write_text('[[actuator]]\nid = 0\nname = "left"\nserial_number = "SN-77"\n')
    # The recording holds the number, and its window again.
    hmd.replay(log, config=config, output=folder / "unit/recorded.mcap")
    assert run(folder, out, config, workers=0) == 0
    [window] = pq.read_table(out / "fleet.parquet").to_pylist()
    assert (window["unit"], window["serial_number"], window["actuator"]) == ("SN-77", "SN-77", "left")
    assert json.loads((out / "fleet.json").read_text())["counts"]["windows_twice"] == 1


def test_bad_logs_are_listed_and_end_nothing(spoilt: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run(spoilt, out, workers=2) == 3
    summary = json.loads((out / "fleet.json").read_text())
    counts = {"logs": 8, "judged": 5, "bad": 2, "with_losses": 1, "same_twice": 1, "windows": 5, "units": 2}
    assert summary["counts"] == counts | {"passed_over": 0, "windows_twice": 0}
    assert [bad["log"] for bad in summary["bad"]] == ["bad.mcap", "empty.log"]
    assert [bad["message"].split(": ")[0] for bad in summary["bad"]] == ["bad.mcap", "empty.log"]
    assert "; the first: bad.mcap:1: expected a stamp" in summary["bad"][0]["message"]
    assert summary["lossy"][0]["log"] == "torn.log"
    assert summary["twice"] == [{"log": "zz-copy.log", "same_as": "unit-0/day-00.log"}]
    report = (out / "report.html").read_text()
    assert all(escape(bad["message"]) in report for bad in summary["bad"])
    # A log that is mended is assessed, and only that one.
    (spoilt / "empty.log").write_bytes((spoilt / "unit-0/day-02.log").read_bytes().replace(b"(17", b"(18"))
    assert run(spoilt, out, workers=2) == 3
    assert json.loads((out / "fleet.json").read_text())["counts"]["judged"] == 6


def test_the_report_finds_the_unit_that_wears(fleet: Path, tmp_path: Path) -> None:
    out, config = tmp_path / "out", tmp_path / "hmd.toml"
    config.write_text(EXACT)
    assert run(fleet, out, config, workers=2) == 0
    units = read_units(out / "fleet.parquet")
    assert [unit.name for unit in units] == [f"unit-{n}/ema0" for n in range(UNITS)]
    assert worst(units)[0].name == "unit-2/ema0"
    found = trends(units)
    assert (found[0].unit.name, found[0].fault) == ("unit-2/ema0", 0)
    # 0.04 a day.
    assert found[0].per_month == pytest.approx(30 * 0.04, rel=0.05)
    assert all(trend.unit.name == "unit-2/ema0" for trend in found)
    assert {(outlier.unit.name, outlier.fault) for outlier in outliers(units)} == {("unit-2/ema0", 0)}
    summary = json.loads((out / "fleet.json").read_text())
    assert [unit["unit"] for unit in summary["worst"]] == [unit.name for unit in worst(units)]
    assert summary["worst"][0]["largest_fault"] == "friction"
    assert summary["growing"][0]["damage_per_30_days"] == found[0].per_month
    assert [(unlike["unit"], unlike["fault"]) for unlike in summary["unlike"]] == [("unit-2/ema0", "friction")]
    assert summary["hardly_assessed"] == []
    rows = pq.read_table(out / "fleet.parquet").to_pylist()
    # With the other columns of the export that a replay's line has.
    last = hmd.replay(fleet / "unit-2/day-09.log", config=config).to_arrow()
    found_row, [expected] = next(row for row in rows if row["log"] == "unit-2/day-09.log"), last.to_pylist()
    for name in ("suspects", "serial_number", *(name for name in last.column_names if name.startswith("state_"))):
        assert found_row[name] == expected[name], name
    text = (out / "report.html").read_text()
    assert "<svg" in text
    assert not re.search(r"(src|href)\s*=|url\(|<script", text)
    Balanced().feed(text)


def test_a_unit_that_was_never_assessed_is_listed_as_such(fleet: Path, tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    for day in range(3):
        log = fleet / f"unit-1/day-{day:02}.log"
        shifted(folder / f"good/{day}.log", log.read_text(), 1)
    # Every second currents frame is missing.
    lines = (fleet / "unit-1/day-00.log").read_text().splitlines(keepends=True)
    currents = [n for n, line in enumerate(lines) if " 100#" in line]
    for n in currents[::2]:
        lines[n] = ""
    (folder / "dumb").mkdir()
    (folder / "dumb/0.log").write_text("".join(lines))
    config = tmp_path / "hmd.toml"
    config.write_text(EXACT)
    assert run(folder, tmp_path / "out", config, workers=0) == 3
    units = read_units(tmp_path / "out/fleet.parquet")
    assert [unit.name for unit in rarely_assessed(units)] == ["dumb/ema0"]
    assert [unit.name for unit in worst(units)] == ["good/ema0"]
    assert "Hardly assessed" in (tmp_path / "out/report.html").read_text()


def measured(log: Path, table: Path) -> None:
    """The samples of a log as a table of measured signals."""
    raw = hmd.read_raw(log)
    table.parent.mkdir(parents=True, exist_ok=True)
    columns = ["t_ns", "i_a_a", "i_b_a", "i_c_a", "motor_counts", "output_counts", "setpoint"]
    raw = raw.filter(pc.is_valid(raw["setpoint"])).select(columns)
    if table.suffix == ".parquet":
        pq.write_table(raw, table)
    else:
        csv.write_csv(raw.set_column(0, "t_ns", raw["t_ns"].cast("int64")), table)


MAP = """[map]
time = { signal = "t_ns", unit = "ns" }
currents.a = { signal = "i_a_a", unit = "A" }
currents.b = { signal = "i_b_a", unit = "A" }
currents.c = { signal = "i_c_a", unit = "A" }
position.motor = { signal = "motor_counts", unit = "counts" }
position.output = { signal = "output_counts", unit = "counts" }
command.position = { signal = "setpoint", unit = "rad" }
"""


def test_all_formats_are_assessed_and_what_is_none_is_counted(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out, config = tmp_path / "logs", tmp_path / "out", tmp_path / "hmd.toml"
    log = fleet / "unit-1/day-00.log"
    measured(log, folder / "csv/a.CSV")
    measured(log, folder / "parquet/a.parquet")
    (folder / "candump").mkdir()
    (folder / "candump/a.log").write_bytes(log.read_bytes())
    (folder / "candump/notes.txt").write_text("none")
    measured(log, folder / "candump/export.csv")
    for name in ("asc", "blf", "mf4"):
        (folder / name).mkdir()
        (folder / name / f"a.{name}").write_bytes((REPOSITORY / f"fixtures/foreign/frames.{name}").read_bytes())

    config.write_text(MAP)
    assert run(folder, out, config, workers=0) in (0, 3)
    summary = json.loads((out / "fleet.json").read_text())
    known = {"csv/a.CSV", "parquet/a.parquet", "candump/a.log", "asc/a.asc", "blf/a.blf", "mf4/a.mf4"}
    assert summary["counts"]["logs"] == len(known)
    assert summary["counts"]["passed_over"] == 2
    assert [(some["files"], some["first"]) for some in summary["passed_over"]] == [
        (1, "candump/notes.txt"),
        (1, "candump/export.csv"),
    ]
    told = capsys.readouterr().err
    assert "1 file passed over, the first candump/export.csv: table beside other logs" in told
    assert "candump/notes.txt" in (out / "report.html").read_text()
    rows = pq.read_table(out / "fleet.parquet").to_pylist()
    for table in ("csv/a.CSV", "parquet/a.parquet"):
        expected = hmd.replay(folder / table, config=config).windows
        assert expected
        assert [row["k1"] for row in rows if row["log"] == table] == [window["k"][0] for window in expected]

    # Without a map nothing says what the signals are.
    assert run(folder, tmp_path / "without", workers=0) in (0, 3)
    summary = json.loads((tmp_path / "without/fleet.json").read_text())
    assert summary["counts"]["logs"] == len(known) - 2
    assert {some["files"]: some["first"] for some in summary["passed_over"]}[2] == "csv/a.CSV"
    assert "2 files passed over, the first csv/a.CSV: table of measured signals" in capsys.readouterr().err


def test_a_window_in_two_recordings_of_a_unit_counts_once(fleet: Path, tmp_path: Path) -> None:
    folder, out, one = tmp_path / "logs", tmp_path / "out", tmp_path / "one.log"
    hmd.simulate(one, faults={"friction": 0.3}, rate_hz=400, noise_a=0.03, windows=4, seed=5)
    lines = one.read_text().splitlines(keepends=True)
    (folder / "A").mkdir(parents=True)
    (folder / "A/whole.log").write_bytes(one.read_bytes())
    # Ends within a window, which is cut short there; its name comes first.
    (folder / "A/begin.log").write_text("".join(lines[: len(lines) * 6 // 10]))
    # The same frames of another unit are another unit's.
    (folder / "B").mkdir()
    (folder / "B/cut.log").write_text("".join(lines[: len(lines) // 2]))
    run(folder, out, workers=0)
    rows = [row for row in pq.read_table(out / "fleet.parquet").to_pylist() if row["unit"] == "A/ema0"]
    whole = hmd.replay(folder / "A/whole.log").windows
    assert sorted(row["t_start_ns"].value for row in rows) == [window["t_start_ns"] for window in whole]
    begin = hmd.replay(folder / "A/begin.log").windows
    assert len(begin) >= 2
    statuses = {window["t_start_ns"]: window["status"] for window in whole}
    assert all(row["status"] == statuses[row["t_start_ns"].value] for row in rows)
    summary = json.loads((out / "fleet.json").read_text())
    assert summary["counts"]["windows_twice"] == len(begin)
    assert sum(same["windows"] for same in summary["overlapping"]) == len(begin)
    assert {same["log"] for same in summary["overlapping"]} <= {"A/whole.log", "A/begin.log"}
    assert "Windows in two recordings" in (out / "report.html").read_text()
    [unit] = [unit for unit in read_units(out / "fleet.parquet") if unit.name == "A/ema0"]
    assert unit.windows == len(whole)


class Balanced(HTMLParser):
    """Every element that is opened is closed, in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag != "meta":
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: Any) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_names_from_logs_cannot_write_html(fleet: Path, tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    (folder / "<b>unit").mkdir(parents=True)
    (folder / "<b>unit" / "a.log").write_bytes((fleet / "unit-2/day-09.log").read_bytes())
    assert run(folder, tmp_path / "out", workers=1) == 0
    assert "<b>" not in (tmp_path / "out/report.html").read_text()


@pytest.mark.parametrize("recipe", ["parallel.sh", "slurm.sh"])
def test_the_recipes_give_the_same(fleet: Path, tmp_path: Path, recipe: str) -> None:
    calm, out = tmp_path / "calm", tmp_path / "out"
    assert run(fleet, calm, workers=0) == 0
    expected = results(calm)
    script = ["bash", str(REPOSITORY / "python/recipes" / recipe), str(fleet), str(out)]
    # What Slurm sets in the tasks of an array.
    tasks = 3 if recipe == "slurm.sh" else 1
    python = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    for task in range(tasks):
        environment = {"SLURM_ARRAY_TASK_ID": str(task), "SLURM_ARRAY_TASK_COUNT": str(tasks), "PATH": python}
        subprocess.run(script, env={**os.environ, **environment}, check=True)
    assert results(out) == expected
    assert run(fleet, out, workers=0) == 0
    assert pq.read_table(out / "fleet.parquet").equals(pq.read_table(calm / "fleet.parquet"))


def test_an_array_of_tasks_gives_the_same(fleet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for task in range(3):
        words = ["-m", "hmd.fleet.one", str(fleet), "-o", str(out), "--task", str(task), "--of", "3"]
        subprocess.run([sys.executable, *words], check=True)
        assert len(results(out)) == UNITS * DAYS * (task + 1) // 3
    refused = subprocess.run(
        [sys.executable, "-m", "hmd.fleet.one", str(fleet), "-o", str(out), "--task", "3", "--of", "3"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert refused.returncode == 2
    assert "--task: expected a number from 0 to 2, found 3" in refused.stderr

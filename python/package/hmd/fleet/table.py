"""All results as one Parquet table, a row for each window, in the order of logs."""

import hashlib
import json
import os
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from .._tables import metadata_of
from .contract import Job, Outcome, PassedOver, message_of, shown

ROWS = 50_000
"""Rows that are held in memory."""

FAULTS = ("friction", "backlash", "short_a", "short_b", "short_c", "eccentricity", "gain")


def _unit(unit: str) -> dict[str, str]:
    return {"unit": unit}


def _schema() -> pa.Schema:
    number, flag, text = pa.float64(), pa.bool_(), pa.string()
    fields = [
        pa.field("log", text, nullable=False),
        pa.field("unit", text, nullable=False),
        pa.field("actuator", text, nullable=False),
        pa.field("window", pa.int64(), nullable=False),
        pa.field("t_start_ns", pa.timestamp("ns", "UTC"), nullable=False, metadata=_unit("ns, UTC")),
        pa.field("status", text, nullable=False),
        pa.field("reason", text, nullable=False),
        pa.field("health", text, nullable=False),
        pa.field("faults", text, nullable=False),
    ]
    fields += [pa.field(f"k{n}", number, metadata=_unit("1")) for n in range(1, 9)]
    fields += [pa.field(f"k{n}_sigma", number, metadata=_unit("1")) for n in range(1, 9)]
    fields += [pa.field(f"k{n}_observable", flag) for n in range(1, 9)]
    fields += [pa.field(f"damage_{fault}", number, metadata=_unit("1")) for fault in FAULTS]
    fields += [
        pa.field("cost", number, metadata=_unit("1")),
        pa.field("residual_rms_a", number, metadata=_unit("A")),
        pa.field("evaluations", pa.int64(), nullable=False),
    ]
    for unit in ("h", "cycles"):
        fields += [pa.field(f"rul_{p}_{unit}", number, metadata=_unit(unit)) for p in ("p10", "p50", "p90")]
    fields += [pa.field("suspects", text, nullable=False)]
    fields += [pa.field(f"state_{fault}", text, nullable=False) for fault in FAULTS]
    fields += [pa.field("serial_number", text, nullable=False)]
    return pa.schema(fields)


SCHEMA = _schema()


def row(log: str, window: dict[str, Any], serial_numbers: dict[str, str]) -> dict[str, Any]:
    """A row out of a line of `hmd replay --json`, of a log with these serial numbers of its actuators by name."""
    found = {name: window[name] for name in ("actuator", "window", "t_start_ns", "status", "health")}
    found |= {name: window[name] for name in ("cost", "residual_rms_a", "evaluations")}
    unit = unit_of(log, window["actuator"], serial_numbers)
    found |= {"log": log, "unit": unit, "reason": window.get("reason", ""), "faults": ",".join(window["faults"])}
    k = window["k"] or [None] * 8
    for n in range(8):
        found[f"k{n + 1}"] = k[n]
        found[f"k{n + 1}_sigma"] = (window["sigma"] or [None] * 8)[n]
        found[f"k{n + 1}_observable"] = (window["observable"] or [None] * 8)[n]
    # The gain's damage is its distance from ½; k7 is a direction and no damage.
    damages = [*k[:6], None if k[7] is None else 2 * abs(k[7] - 0.5)]
    found |= {f"damage_{fault}": damage for fault, damage in zip(FAULTS, damages, strict=True)}
    for kind in ("h", "cycles"):
        rul = window[f"rul_{kind}"] or {}
        found |= {f"rul_{p}_{kind}": rul.get(p) for p in ("p10", "p50", "p90")}
    found |= {f"state_{fault}": window.get("states", {}).get(fault, "") for fault in FAULTS}
    found |= {"suspects": ",".join(window.get("suspects", []))}
    return found | {"serial_number": serial_number_of(window["actuator"], serial_numbers) or ""}


def serial_number_of(actuator: str, serial_numbers: dict[str, str]) -> str | None:
    """The serial number of an actuator, if the log holds one."""
    if len(serial_numbers) == 1:
        # Its writer may have called the one actuator otherwise.
        return next(iter(serial_numbers.values()))
    return serial_numbers.get(actuator)


def unit_of(log: str, actuator: str, serial_numbers: dict[str, str]) -> str:
    """Whose windows these are: the serial number if the log holds one, else the log's folder, else its own name."""
    serial_number = serial_number_of(actuator, serial_numbers)
    if serial_number is not None:
        return serial_number
    place = Path(log)
    owner = place.parent if place.parent.name else place.with_suffix("")
    return f"{owner.as_posix()}/{actuator}"


VERSION = 2
"""Of how the files are made of the same inputs."""


def inputs_of(job: Job, outcomes: Iterable[Outcome], passed_over: Iterable[PassedOver]) -> str:
    """Hash of what a table and its page are made of: columns, which log has which result, what is no log."""
    digest = hashlib.sha256(f"{VERSION} {job.identity}\0{' '.join(SCHEMA.names)}\n".encode())
    digest.update("".join(f"{some.files} {some.first} {some.reason}\n" for some in passed_over).encode())
    for outcome in outcomes:
        digest.update(f"{shown(Path(outcome.log))}\0{outcome.key}\0{outcome.message}\n".encode())
    return digest.hexdigest()


def is_current(path: Path, inputs: str) -> bool:
    """Whether a table is made of exactly that."""
    if not path.exists():
        return False
    try:
        metadata = pq.read_schema(path).metadata or {}
    except pa.ArrowInvalid:
        return False
    return metadata.get(b"inputs") == inputs.encode()


def write_table(path: Path, inputs: str, rows: Iterator[dict[str, Any]]) -> int:
    """Writes the table, as a whole or not at all; its number of rows."""
    temporary = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    written = 0
    schema = SCHEMA.with_metadata({"inputs": inputs, **metadata_of(SCHEMA)})
    with pq.ParquetWriter(temporary, schema, compression="zstd") as writer:
        held: list[dict[str, Any]] = []
        for found in rows:
            held.append(found)
            if len(held) == ROWS:
                writer.write_table(pa.Table.from_pylist(held, schema))
                written, held = written + len(held), []
        if held:
            writer.write_table(pa.Table.from_pylist(held, schema))
            written += len(held)
    temporary.replace(path)
    return written


STATUSES = ("ok", "degraded", "unmodelled", "invalid")
"""From the one that says most; of a window in two recordings, that of the fuller one counts."""

Window = tuple[str, str, str, int]
"""What a window is known by: configuration, unit, actuator and start, UTC ns."""


class Results:
    """Reads the results of a run, one file at a time, and counts what they say of their logs."""

    def __init__(self, folder: Path, job: Job, outcomes: list[Outcome]) -> None:
        self.folder, self.job, self.outcomes = folder, job, outcomes
        self.bad: list[dict[str, str]] = []
        self.lossy: list[dict[str, str]] = []
        self.twice: list[dict[str, str]] = []
        self.overlapping: list[dict[str, Any]] = []
        self.assessed: list[tuple[str, str]] = []
        """Logs with windows, each with the key of its result."""
        self._survey()

    def _survey(self) -> None:
        """What the first lines of the results say; logs of the same bytes are assessed under the first name."""
        first: dict[str, str] = {}
        for outcome in self.outcomes:
            log = shown(Path(outcome.log).relative_to(self.folder))
            if not outcome.key:
                self.bad.append({"log": log, "message": outcome.message})
                continue
            if outcome.key in first:
                self.twice.append({"log": log, "same_as": first[outcome.key]})
                continue
            first[outcome.key] = log
            with self.job.result(outcome.key).open(encoding="utf-8") as lines:
                head = json.loads(next(lines))
            message = message_of(log, head["message"])
            if head["exit"] == 1:
                self.bad.append({"log": log, "message": message})
                continue
            if head["exit"] == 3:
                self.lossy.append({"log": log, "message": message})
            self.assessed.append((log, outcome.key))

    def rows(self) -> Iterator[dict[str, Any]]:
        """Rows of all windows; one that stands in two recordings of a unit only once."""
        owners = self._owners()
        for log, key in self.assessed:
            others: Counter[str] = Counter()
            for known_by, window, serial_numbers in self._windows(log, key):
                owner = owners.get(known_by, log)
                if owner == log:
                    yield row(log, window, serial_numbers)
                else:
                    others[owner] += 1
            same = ({"log": log, "windows": count, "same_in": owner} for owner, count in sorted(others.items()))
            self.overlapping.extend(same)

    def _windows(self, log: str, key: str) -> Iterator[tuple[Window, dict[str, Any], dict[str, str]]]:
        with self.job.result(key).open(encoding="utf-8") as lines:
            head = json.loads(next(lines))
            serial_numbers = head["serial_numbers"]
            for line in lines:
                window = json.loads(line)
                actuator = window["actuator"]
                unit = unit_of(log, actuator, serial_numbers)
                yield (head["config"], unit, actuator, window["t_start_ns"]), window, serial_numbers

    def _owners(self) -> dict[Window, str]:
        """The log that a window counts for, of those in recordings of a unit that overlap.

        That is the one whose result says most, of equal ones the first by name. Others are held no longer than it takes
        to see that nothing overlaps them.
        """
        spans: dict[tuple[str, ...], list[tuple[int, int, int]]] = defaultdict(list)
        for n, (log, key) in enumerate(self.assessed):
            of_log: dict[tuple[str, ...], tuple[int, int]] = {}
            for (*of, start_ns), _, _ in self._windows(log, key):
                least, most = of_log.get(tuple(of), (start_ns, start_ns))
                of_log[tuple(of)] = min(least, start_ns), max(most, start_ns)
            for known_by, (least, most) in of_log.items():
                spans[known_by].append((least, most, n))
        overlapping: set[int] = set()
        for of_unit in spans.values():
            newest, last = -1, -1
            for least, most, n in sorted(of_unit):
                if least <= newest:
                    overlapping |= {last, n}
                if most > newest:
                    newest, last = most, n
        best: dict[Window, tuple[int, str]] = {}
        for n in sorted(overlapping):
            log, key = self.assessed[n]
            for known, window, _ in self._windows(log, key):
                found = STATUSES.index(window["status"]), log
                best[known] = min(best.get(known, found), found)
        return {known: log for known, (_, log) in best.items()}

"""One log in, one result out. Nothing here knows what engine runs it; nothing needs more than the standard library."""

import contextlib
import hashlib
import json
import os
import socket
import warnings
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path

from .. import _hmd
from .._assessed import replay
from .._hmd import ConfigError, Error
from .._tables import DataLossWarning

CONTRACT = 2
"""Version of the result files; a part of their names."""

NO_MAP = "table of measured signals, whose configuration has no section [map]"
"""Why a table is no log."""

PLACE = "{log}"
"""Stands for the path of the log in the message of a result."""

NO_LOGS = "expected logs of a format that hmd replay reads, found none"
"""Why a folder has nothing to assess."""

LINK = "link to a folder that is searched already"
"""Why a folder is not searched again."""

CHUNK = 1 << 20
"""Bytes of a log that are held while it is hashed."""


@dataclass(frozen=True)
class Job:
    """What a run does with every log; the same on every computer of it."""

    out: str
    """Folder of the results, which all computers see."""
    config: str | None
    """Of every log; or a folder with one for each unit, `UNIT.toml`."""
    seed: int
    identity: str
    """Hash of the configuration as checked, of the calibrations that it leads to, and of the files that it names."""

    @classmethod
    def prepared(cls, out: Path, config: Path | None, seed: int) -> "Job":
        """Checks the configuration before any log is read.

        Raises `ConfigError` where it is bad.
        """
        _identity_of.cache_clear()
        name = None if config is None else str(Path(config).resolve())
        if config is None or not Path(config).is_dir():
            return cls(str(out.resolve()), name, seed, _identity_of(name, ""))
        of_units = sorted(Path(config).resolve().glob("*.toml"))
        if not of_units:
            raise ConfigError(f"{config}: expected configurations called UNIT.toml, found none")
        all_of_them = " ".join(f"{file.name} {_identity_of(str(file), '')}" for file in of_units)
        return cls(str(out.resolve()), name, seed, hashlib.sha256(all_of_them.encode()).hexdigest())

    def of(self, log: Path) -> "Job":
        """The same for one log: with the configuration of its unit, where each has its own.

        That is called as the log's serial number, else as its folder; what has neither is assessed by `default.toml`,
        or without one by the defaults.
        """
        if self.config is None or not os.path.isdir(self.config):
            return self
        serials = list(_hmd.serial_numbers(log).values())
        names = [*(serials if len(serials) == 1 else []), log.parent.name, "default"]
        places = (Path(self.config, f"{name}.toml") for name in names if os.path.basename(name) == name)
        config = next((str(place) for place in places if place.is_file()), None)
        return replace(self, config=config, identity=_identity_of(config, self.identity))

    def key(self, content: str) -> str:
        """Name of the result for a log with these bytes."""
        made_of = {
            "contract": CONTRACT,
            "content": content,
            "config": self.identity,
            "version": _hmd.VERSION,
            "seed": self.seed,
        }
        return hashlib.sha256(json.dumps(made_of, sort_keys=True).encode()).hexdigest()

    def has_result(self, key: str) -> bool:
        """Whether there is one; a file that lost its content is none."""
        try:
            return self.result(key).stat().st_size > 0
        except FileNotFoundError:
            return False

    def result(self, key: str) -> Path:
        """Where the result of that name stands; in one of 256 folders, because a folder of 100 000 files is slow."""
        return Path(self.out, "results", key[:2], f"{key}.jsonl")


@lru_cache(maxsize=4096)
def _identity_of(config: str | None, _of_all: str) -> str:
    """Hash of a configuration as checked, of the calibrations that it leads to, and of the files that it names.

    Read once for each identity of all configurations: a worker lives longer than a run.
    """
    checked, model, files = _hmd.config_identity(config)
    digest = hashlib.sha256(f"{checked} {model}".encode())
    for file in files:
        # A file of events need not be there yet.
        digest.update(f" {hash_of(Path(file)) if os.path.exists(file) else None}".encode())
    return digest.hexdigest()


@dataclass(frozen=True)
class Outcome:
    """What became of a log. Without a key there is no result: the log could not be read at all, and is tried again."""

    log: str
    size: int = 0
    mtime_ns: int = 0
    content: str = ""
    key: str = ""
    computed: bool = False
    message: str = ""


@dataclass(frozen=True)
class PassedOver:
    """Files that are no logs, for one reason."""

    reason: str
    files: int
    first: str
    """The first of them, relative to the folder."""


@dataclass(frozen=True)
class Found:
    """What lies below a folder."""

    logs: list[Path]
    passed_over: list[PassedOver]

    def sentences(self) -> Iterator[str]:
        """What was passed over, a sentence for each reason."""
        for some in self.passed_over:
            yield f"{some.files} file{'s' if some.files > 1 else ''} passed over, the first {some.first}: {some.reason}"


def find_logs(folder: Path, job: Job) -> Found:
    """All logs below a folder, by name; none of the results. Of each folder in it, those that `hmd replay` takes.

    Linked folders are searched too, each folder once. Tables of measured signals are logs where their configuration
    says what the signals are.
    """
    logs: list[Path] = []
    others: dict[str, list[Path]] = {}
    for place in _folders_below(folder, Path(job.out), others):
        of_folder, passed_over = _hmd.logs_in(place)
        for name, is_table in of_folder:
            log = Path(name)
            if is_table and not _has_map(job.of(log).config, job.identity):
                others.setdefault(NO_MAP, []).append(log)
            else:
                logs.append(log)
        for name, reason in passed_over:
            others.setdefault(reason, []).append(Path(name))
    counted = (
        PassedOver(reason, len(files), min(shown(file.relative_to(folder)) for file in files))
        for reason, files in sorted(others.items())
    )
    return Found(sorted(logs), list(counted))


def _folders_below(folder: Path, out: Path, others: dict[str, list[Path]]) -> Iterator[Path]:
    """A folder and those below it, each once, linked ones last; what cannot be searched is added to the others."""

    def unreadable(error: OSError) -> None:
        others.setdefault(f"folder: {error.strerror}", []).append(Path(error.filename))

    seen, waiting = {out}, [folder]
    while waiting:
        for place, folders, _ in os.walk(waiting.pop(0), onerror=unreadable):
            folders.sort()
            real = Path(place).resolve()
            if real in seen:
                folders.clear()
                if os.path.islink(place) and real != out:
                    others.setdefault(LINK, []).append(Path(place))
                continue
            seen.add(real)
            waiting += [link for name in folders if (link := Path(place, name)).is_symlink()]
            yield Path(place)


def shown(path: Path) -> str:
    """A path as text for people and files; what is no UTF-8 in it by its bytes."""
    return os.fsencode(path.as_posix()).decode("utf-8", "backslashreplace")


@lru_cache(maxsize=4096)
def _has_map(config: str | None, _of_all: str) -> bool:
    """Whether a configuration has a section `[map]`; read once for each identity of all configurations."""
    return _hmd.has_map(config)


def message_of(log: str, message: str) -> str:
    """The message of a result, of the log of that path."""
    # Results of earlier versions begin with another word for it.
    message = PLACE + message.removeprefix("log") if message.startswith("log:") else message
    return message.replace(PLACE, log)


def hash_of(path: Path) -> str:
    """SHA-256 of a file, in hex."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def one_log(log: Path, job: Job) -> Outcome:
    """Assesses a log unless its result is there already. May be run again, or twice at the same time.

    A log that `hmd` refuses has a result too, which says why. Raises `ConfigError`, which is no log's fault.
    """
    try:
        before = log.stat()
        job = job.of(log)
        content = hash_of(log)
        key = job.key(content)
        place = job.result(key)
        computed = not job.has_result(key)
        if computed:
            text = _assess(log, content, job)
            after = log.stat()
            if (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
                return Outcome(str(log), message="expected a log that nobody writes, found one that changed")
            write_whole(place, text)
    except OSError as error:
        return Outcome(str(log), message=f"{error.strerror or error}")
    return Outcome(str(log), before.st_size, before.st_mtime_ns, content, key, computed)


def _assess(log: Path, content: str, job: Job) -> str:
    """A line about the result, then those of `hmd replay --json`."""
    lines: list[str] = []
    code, message = 0, ""
    try:
        with warnings.catch_warnings():
            # What was lost stands in the result.
            warnings.simplefilter("ignore", DataLossWarning)
            assessed = replay(log, config=job.config, seed=job.seed, threads=1)
        lines = assessed.lines
        if assessed.loss is not None:
            code, message = 3, assessed.loss
    except ConfigError:
        raise
    except Error as error:
        # What the bytes mean does not depend on where they lie.
        said = str(error)
        for name in (str(log), os.fsencode(log).decode("utf-8", "replace")):
            said = said.replace(name, PLACE)
        code, message = 1, said
    head = {
        "contract": CONTRACT,
        "content": content,
        "config": job.identity,
        "version": _hmd.VERSION,
        "seed": job.seed,
        "exit": code,
        "message": message,
        "serial_numbers": _hmd.configured_serial_numbers(job.config) | _hmd.serial_numbers(log),
    }
    return "".join(f"{line}\n" for line in [json.dumps(head), *lines])


def write_whole(path: Path, text: str) -> None:
    """Writes a file that is there as a whole or not at all, even after a power cut."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f"{path.name}.{socket.gethostname()}.{os.getpid()}.tmp")
    with temporary.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)


class Index:
    """What is known of logs without reading them: a file of the same size and time of change has the same bytes.

    A cache only: without it, every log is hashed again.
    """

    def __init__(self, out: Path) -> None:
        self.path = out / "index.jsonl"
        self.known: dict[str, Outcome] = {}
        if self.path.exists():
            with self.path.open(encoding="utf-8", errors="replace") as file:
                for line in file:
                    # A line that is none is of a log that is read again.
                    with contextlib.suppress(ValueError, TypeError):
                        outcome = Outcome(**json.loads(line))
                        self.known[outcome.log] = outcome

    def find(self, log: Path, job: Job) -> Outcome | None:
        """The log's outcome if its result is there."""
        known = self.known.get(str(log))
        if known is None:
            return None
        try:
            now = log.stat()
        except OSError:
            return None
        if (known.size, known.mtime_ns) != (now.st_size, now.st_mtime_ns):
            return None
        key = job.of(log).key(known.content)
        return Outcome(known.log, known.size, known.mtime_ns, known.content, key) if job.has_result(key) else None

    def write(self, outcomes: list[Outcome]) -> None:
        """Stores what was read."""
        kept = (asdict(outcome) | {"computed": False} for outcome in outcomes if outcome.content)
        write_whole(self.path, "".join(json.dumps(line) + "\n" for line in kept))

"""Statistics of a fleet's table: the worst units, growing damage, units unlike the others."""

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from .table import FAULTS

HEALTH = ("unknown", "nominal", "watch", "warning", "critical")
"""From best known to worst."""

NEWEST = 64
"""Windows of a unit that are looked at, the newest ones."""

TREND_WINDOWS = 8
"""Fewer windows than this show no trend: even a perfect one could be chance."""

TREND_Z = 3.0
"""Mann–Kendall score of a trend: by chance in one of 700 steady units."""

LEVEL_WINDOWS = 5
"""Newest windows whose median is a unit's level."""

OUTLIER_Z = 6.0
"""Distance from the fleet's median, in its own robust standard deviations."""

SPREAD_LEAST = 0.01
"""Smallest spread of a fleet that is used: what estimates differ by anyway."""

MONTH_S = 30 * 86_400.0


@dataclass(frozen=True)
class Unit:
    """One actuator: its damages over time, the order of faults as in `FAULTS`."""

    name: str
    health: str
    faults: str
    time_s: NDArray[np.float64]
    damage: NDArray[np.float64]
    windows: int
    refused: int
    """Windows that were not fit to be assessed, or that no fault vector explains."""

    @property
    def level(self) -> NDArray[np.float64]:
        """Median damage of the newest windows; not a number where none was assessed."""
        if not len(self.damage):
            return np.full(len(FAULTS), np.nan)
        return np.median(self.damage[-LEVEL_WINDOWS:], axis=0)

    @property
    def largest(self) -> float:
        """Largest of these; below any damage where none was assessed."""
        return float(self.level.max()) if len(self.damage) else -1.0


@dataclass(frozen=True)
class Trend:
    """A damage that grows."""

    unit: Unit
    fault: int
    per_month: float
    z: float


@dataclass(frozen=True)
class Outlier:
    """A damage unlike the fleet's."""

    unit: Unit
    fault: int
    level: float
    fleet: float
    z: float


def read_units(table: Path) -> list[Unit]:
    """Units of a table, by name."""
    # Words as numbers: a word of its own for each row would be most of the memory.
    words = ["unit", "health", "faults"]
    rows = pq.read_table(
        table, columns=["t_start_ns", *words, *(f"damage_{fault}" for fault in FAULTS)], read_dictionary=words
    ).unify_dictionaries()
    columns = {name: rows[name].combine_chunks() for name in words}
    of, health, faults = (columns[name].indices.to_numpy() for name in words)
    known = {name: columns[name].dictionary.to_pylist() for name in words}
    rank = np.argsort(np.argsort(np.array(known["unit"], dtype=object)))[of] if len(of) else of
    order = np.lexsort((rows["t_start_ns"].cast("int64").to_numpy(), rank))
    of, health, faults = of[order], health[order], faults[order]
    time_s = rows["t_start_ns"].cast("int64").to_numpy()[order] / 1e9
    damage = np.column_stack([rows[f"damage_{fault}"].to_numpy()[order] for fault in FAULTS])
    # One more than there are units; of no rows none.
    bounds = np.flatnonzero(np.r_[True, of[1:] != of[:-1], True]) if len(of) else np.array([], dtype=int)
    units = []
    for start, end in itertools.pairwise(bounds):
        assessed = start + np.flatnonzero(np.isfinite(damage[start:end]).all(axis=1))
        newest = assessed[-NEWEST:]
        last = assessed[-1] if len(assessed) else end - 1
        units.append(
            Unit(
                name=known["unit"][of[start]],
                health=known["health"][health[last]],
                faults=known["faults"][faults[last]],
                time_s=time_s[newest],
                damage=damage[newest],
                windows=int(end - start),
                refused=int(end - start - len(assessed)),
            )
        )
    return units


def worst(units: list[Unit]) -> list[Unit]:
    """The units that are not nominal, the worst first: by health, then by their largest damage."""
    found = [unit for unit in units if HEALTH.index(unit.health) > HEALTH.index("nominal")]
    return sorted(found, key=lambda unit: (-HEALTH.index(unit.health), -unit.largest, unit.name))


def rarely_assessed(units: list[Unit]) -> list[Unit]:
    """The units of whose windows half or more could not be assessed, the least assessed first."""
    found = [unit for unit in units if 2 * unit.refused >= unit.windows]
    return sorted(found, key=lambda unit: (-unit.refused / unit.windows, -unit.windows, unit.name))


def trends(units: list[Unit]) -> list[Trend]:
    """Damages that grow beyond chance, the fastest first: Theil–Sen slope, Mann–Kendall score."""
    found = []
    for unit in units:
        n = len(unit.time_s)
        if n < TREND_WINDOWS:
            continue
        i, j = np.triu_indices(n, 1)
        apart = unit.time_s[j] - unit.time_s[i]
        rise = unit.damage[j] - unit.damage[i]
        later = apart > 0
        if not later.any():
            continue
        # Ties only make the true variance smaller.
        z = np.sign(rise[later]).sum(axis=0) / np.sqrt(n * (n - 1) * (2 * n + 5) / 18)
        for fault in np.flatnonzero(z >= TREND_Z):
            slope = np.median(rise[later, fault] / apart[later])
            if slope > 0:
                found.append(Trend(unit, int(fault), float(slope * MONTH_S), float(z[fault])))
    return sorted(found, key=lambda trend: (-trend.per_month, trend.unit.name))


def outliers(units: list[Unit]) -> list[Outlier]:
    """Damages far from the fleet's median, the farthest first."""
    assessed = [unit for unit in units if len(unit.damage)]
    if len(assessed) < 3:
        return []
    levels = np.array([unit.level for unit in assessed])
    fleet = np.median(levels, axis=0)
    spread = np.maximum(1.4826 * np.median(np.abs(levels - fleet), axis=0), SPREAD_LEAST)
    z = (levels - fleet) / spread
    far = [(n, p) for n, p in zip(*np.nonzero(np.abs(z) > OUTLIER_Z), strict=True)]
    found = [Outlier(assessed[n], int(p), float(levels[n, p]), float(fleet[p]), float(z[n, p])) for n, p in far]
    return sorted(found, key=lambda outlier: (-abs(outlier.z), outlier.unit.name))


@dataclass(frozen=True)
class Lists:
    """The units that somebody should look at, each list in its order."""

    worst: list[Unit]
    growing: list[Trend]
    unlike: list[Outlier]
    hardly_assessed: list[Unit]

    @classmethod
    def of(cls, units: list[Unit]) -> "Lists":
        """Of all units of a fleet."""
        return cls(worst(units), trends(units), outliers(units), rarely_assessed(units))

    def as_json(self) -> dict[str, list[dict[str, Any]]]:
        """As `fleet.json` has them; damages are 0 to 1."""
        return {
            "worst": [
                {
                    "unit": unit.name,
                    "health": unit.health,
                    "faults": [fault for fault in unit.faults.split(",") if fault],
                    "largest_fault": FAULTS[int(np.argmax(unit.level))] if len(unit.damage) else None,
                    "largest_damage": unit.largest if len(unit.damage) else None,
                    "windows": unit.windows,
                    "not_assessed": unit.refused,
                }
                for unit in self.worst
            ],
            "growing": [
                {
                    "unit": trend.unit.name,
                    "fault": FAULTS[trend.fault],
                    "damage": float(trend.unit.level[trend.fault]),
                    "damage_per_30_days": trend.per_month,
                    "mann_kendall_score": trend.z,
                }
                for trend in self.growing
            ],
            "unlike": [
                {
                    "unit": outlier.unit.name,
                    "fault": FAULTS[outlier.fault],
                    "damage": outlier.level,
                    "fleet_median": outlier.fleet,
                    "robust_sigmas": outlier.z,
                }
                for outlier in self.unlike
            ],
            "hardly_assessed": [
                {"unit": unit.name, "windows": unit.windows, "not_assessed": unit.refused}
                for unit in self.hardly_assessed
            ],
        }

"""The fleet on one HTML page: no network, no script, readable on paper and in the dark."""

from html import escape
from typing import Any

import numpy as np

from .statistics import (
    LEVEL_WINDOWS,
    OUTLIER_Z,
    TREND_WINDOWS,
    Lists,
    Outlier,
    Trend,
    Unit,
)
from .table import FAULTS

ROWS = 25
"""Rows of each list; what is left out is counted."""

STYLE = """
:root { color-scheme: light dark; --line: #8884; --mark: #b3261e; }
body { font: 1rem/1.45 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1, h2 { line-height: 1.2; } table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; padding: .25rem .6rem; border-bottom: 1px solid var(--line); overflow-wrap: anywhere; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.wide { overflow-x: auto; } svg { display: block; } svg path { fill: none; stroke: currentColor; stroke-width: 1.5; }
.critical { color: var(--mark); font-weight: 600; }
@media (prefers-color-scheme: dark) { :root { --mark: #ffb4ab; } }
@media print { body { max-width: none; margin: 0; } }
"""


def page(lists: Lists, summary: dict[str, Any]) -> str:
    """The page of the lists of a fleet's units and of `fleet.json`."""
    counts = summary["counts"]
    # The key in `fleet.json` is older.
    facts = [("assessed" if name == "judged" else name.replace("_", " "), str(count)) for name, count in counts.items()]
    parts = [
        _table("counts", ["what", "how many"], [[name, count] for name, count in facts], numbers=(1,)),
        "<h2>Worst actuators</h2>",
        "<p>By health of the newest assessed window, then by the largest damage"
        f" (median of the last {LEVEL_WINDOWS} windows).</p>",
        _list(
            lists.worst, ["unit", "health", "faults", "largest damage", "windows", "not assessed"], _worst, (3, 4, 5)
        ),
        "<h2>Growing damage</h2>",
        "<p>Theil–Sen slope over calendar time where the Mann–Kendall score exceeds chance;"
        f" units with fewer than {TREND_WINDOWS} assessed windows show none.</p>",
        _list(lists.growing, ["unit", "fault", "growth in 30 days", "level", "score", "history"], _trend, (2, 3, 4)),
        "<h2>Unlike the fleet</h2>",
        f"<p>More than {OUTLIER_Z:.0f} robust standard deviations from the median of all units.</p>",
        _list(lists.unlike, ["unit", "fault", "damage", "fleet's median", "distance"], _outlier, (2, 3, 4)),
        "<h2>Hardly assessed</h2>",
        "<p>Half of the windows or more were not fit to be assessed, or nothing that is known explains them.</p>",
        _list(lists.hardly_assessed, ["unit", "windows", "not assessed"], _rarely_assessed, (1, 2)),
        "<h2>Logs without a result</h2>",
        _list(summary["bad"], ["log", "why"], lambda bad: [bad["log"], bad["message"]]),
        "<h2>Logs with losses</h2>",
        _list(summary["lossy"], ["log", "what"], lambda lossy: [lossy["log"], lossy["message"]]),
        "<h2>The same log under two names</h2>",
        _list(summary["twice"], ["log", "same as"], lambda twice: [twice["log"], twice["same_as"]]),
        "<h2>Windows in two recordings</h2>",
        "<p>The windows of a unit that begin at the same time in logs that overlap are one: it counts for the log whose"
        " result says most, of equal ones for the first by name.</p>",
        _list(summary["overlapping"], ["log", "windows", "counted for"], _overlapping, (1,)),
        "<h2>Files that are no logs</h2>",
        _list(summary["passed_over"], ["why", "files", "the first"], _passed_over, (1,)),
        "<h2>How it was made</h2>",
        _table("made", ["what", "value"], [[name, str(value)] for name, value in summary["made"].items()]),
    ]
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Fleet report</title><style>{STYLE}</style></head>\n"
        f"<body><main><h1>Fleet report</h1>\n{body}\n</main></body></html>\n"
    )


def _list(items: list[Any], heads: list[str], cells: Any, numbers: tuple[int, ...] = ()) -> str:
    if not items:
        return "<p>None.</p>"
    shown = _table("list", heads, [cells(item) for item in items[:ROWS]], numbers)
    left = len(items) - ROWS
    return shown + (f"<p>… and {left} more.</p>" if left > 0 else "")


def _table(kind: str, heads: list[str], rows: list[list[str]], numbers: tuple[int, ...] = ()) -> str:
    def cell(tag: str, n: int, text: str) -> str:
        shown = text if text.startswith("<svg ") else escape(text)
        mark = ' class="n"' if n in numbers else ' class="critical"' if text == "critical" else ""
        return f"<{tag}{mark}>{shown}</{tag}>"

    head = "".join(cell("th", n, text) for n, text in enumerate(heads))
    body = "\n".join("<tr>" + "".join(cell("td", n, text) for n, text in enumerate(row)) + "</tr>" for row in rows)
    return (
        f'<div class="wide"><table class="{kind}"><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table></div>'
    )


def _worst(unit: Unit) -> list[str]:
    fault = FAULTS[int(np.argmax(unit.level))]
    return [
        unit.name,
        unit.health,
        unit.faults.replace(",", ", "),
        f"{fault} {100 * unit.largest:.1f} %" if len(unit.damage) else "",
        str(unit.windows),
        str(unit.refused),
    ]


def _rarely_assessed(unit: Unit) -> list[str]:
    return [unit.name, str(unit.windows), str(unit.refused)]


def _trend(trend: Trend) -> list[str]:
    now = trend.unit.level[trend.fault]
    return [
        trend.unit.name,
        FAULTS[trend.fault],
        f"{100 * trend.per_month:+.2f} %",
        f"{100 * now:.1f} %",
        f"{trend.z:.1f}",
        _sparkline(trend.unit, trend.fault),
    ]


def _outlier(outlier: Outlier) -> list[str]:
    return [
        outlier.unit.name,
        FAULTS[outlier.fault],
        f"{100 * outlier.level:.1f} %",
        f"{100 * outlier.fleet:.1f} %",
        f"{outlier.z:+.0f}",
    ]


def _overlapping(same: dict[str, Any]) -> list[str]:
    return [same["log"], str(same["windows"]), same["same_in"]]


def _passed_over(some: dict[str, Any]) -> list[str]:
    return [some["reason"], str(some["files"]), some["first"]]


def _sparkline(unit: Unit, fault: int) -> str:
    """Damage over time, from 0 to its largest; decoration beside the numbers, so it has no text of its own."""
    time, damage = unit.time_s - unit.time_s[0], unit.damage[:, fault]
    x = 2 + 116 * time / max(float(time[-1]), 1e-9)
    y = 26 - 24 * damage / max(float(damage.max()), 1e-9)
    points = "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))
    return f'<svg width="120" height="28" viewBox="0 0 120 28" aria-hidden="true"><path d="M{points}"/></svg>'

"""Results as text for a terminal. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["amount", "machine_line", "table_lines", "value_text"]

_FACTS = (
    "cpu",
    "cores",
    "system",
    "python",
    "load",
    "governor",
    "simple-ros",
    "protobuf",
    "uvloop",
)


def machine_line(facts: Mapping[str, Any]) -> str:
    """The machine in a line."""
    words = [
        str(facts[name]) if name in ("cpu", "system", "python") else f"{name} {facts[name]}"
        for name in _FACTS
        if name in facts
    ]
    if not facts.get("gil", True):
        words.append("no GIL")
    return ", ".join(words)


def amount(value: float) -> str:
    """A figure with as many digits as make sense."""
    if value >= 100:
        return f"{value:,.0f}"
    return f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def value_text(row: Mapping[str, Any]) -> str:
    """The median and its spread, or why there is none."""
    value = row["value"]
    if value is None:
        return f"lost {row['lost']:,}" if row["lost"] else "failed"
    return f"{amount(value['median'])} ({amount(value['min'])} to {amount(value['max'])})"


def table_lines(table: Mapping[str, Any], baseline: str) -> list[str]:
    """One table: a line a peer, each with its ratio to the baseline, better ones larger."""
    lines = [f"{table['title']} ({table['unit']}):"]
    rows = table["peers"]
    base = rows.get(baseline, {}).get("value")
    width = max((len(row["what"]) for row in rows.values()), default=0)
    for name, row in rows.items():
        lost = f"  lost {row['lost']:,} messages!" if row["lost"] and row["value"] else ""
        ratio = ""
        if base and row["value"] and name != baseline:
            ratio = f"  {_times(table, row['value']['median'], base['median'])}"
        lines.append(f"  {row['what']:<{width}}  {value_text(row):<32}{ratio}{lost}".rstrip())
    return lines


def _times(table: Mapping[str, Any], value: float, base: float) -> str:
    return (
        f"{value / base:.2f} of bare" if table["is_better_larger"] else f"{value / base:.2f} x bare"
    )

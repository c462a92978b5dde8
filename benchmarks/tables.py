"""Results as markdown, and beside the bars that were set for them. Pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from simple_ros.benchmark.report import amount, machine_line, value_text

GROUPS = {"ours": "ours", "limit": "bare", "rival": "rival"}
SPEAKS_TCP = ("zmq", "zenoh", "rospy", "rclpy_kilted", "rclpy_jazzy", "nats")


BEGIN, END = "<!-- figures begin -->", "<!-- figures end -->"


def into_page(page: str, document: dict[str, Any], plots: dict[str, str]) -> str:
    """A page with the document between its two marks.

    Raises:
        ValueError: It does not have them.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"the page has no {BEGIN} and {END}")
    return f"{before}{BEGIN}\n{markdown(document, plots)}\n{END}{after}"


def markdown(document: dict[str, Any], plots: dict[str, str] | None = None) -> str:
    """The whole document; with plots, paths of images by the names of tables."""
    lines = [
        f"{machine_line(document['machine'])}; rounds: {document['rounds']}, {document['took_s']} s.",
        "",
    ]
    for name, table in document["tables"].items():
        if plots and name in plots:
            lines += [f"![{table['title']}]({plots[name]})", ""]
        lines += [*_table(table), ""]
    for name, title in (("rest", "At rest"), ("start", "Import times"), ("scale", "One Master")):
        if name in document:
            lines += [f"**{title}**", "", "| | |", "|---|---|"]
            lines += [f"| {what} | {value} |" for what, value in document[name]["rows"]]
            lines.append("")
    lines += _bar_lines(document["bars"])
    lines += [f"- not measured: {name}: {why}" for name, why in document["missing"].items()]
    lines += [
        f"- failed: {one['peer']}, {one['workload']}: {one['reason']}"
        for one in document["failures"]
    ]
    lines += [f"- warning: {line}" for line in document["warnings"]]
    return "\n".join(lines)


def _table(table: dict[str, Any]) -> list[str]:
    has_latency = table["measure"].startswith("p50")
    has_cpu = any("cpu_us" in row["figures"] for row in table["peers"].values())
    rate = table["measure"] == "per_second"
    counts = "workload" in table
    heads = ["peer", "", table["unit"], "simple_ros TCP / it"]
    heads += ["p95, p99"] if has_latency else []
    heads += ["CPU us/message, both"] if has_cpu and rate else []
    heads += ["lost"] if counts else []
    lines = [f"**{table['title']}** ({table['unit']}, median, least to most)", ""]
    lines += ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for row in _sorted(table):
        cells = [
            row["what"] + (" (raw)" if row["raw"] and "raw" not in row["what"] else ""),
            GROUPS[row["group"]],
            value_text(row),
            _ratio_text(row["ours_to_it"]),
        ]
        if has_latency:
            unit = table["measure"].rsplit("_", 1)[1]
            cells.append(", ".join(_median(row, f"p{part}_{unit}") for part in (95, 99)))
        if has_cpu and rate:
            cells.append(_median(row, "cpu_us"))
        if counts:
            cells.append(str(row["lost"]))
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _sorted(table: dict[str, Any]) -> list[dict[str, Any]]:
    """The best first; those without a figure at the end."""
    sign = -1 if table["is_better_larger"] else 1
    return sorted(
        table["peers"].values(),
        key=lambda row: (
            row["value"] is None,
            sign * row["value"]["median"] if row["value"] else 0,
        ),
    )


def _median(row: dict[str, Any], key: str) -> str:
    figure = row["figures"].get(key)
    return amount(figure["median"]) if figure else ""


def _ratio_text(ratio: dict[str, float] | None) -> str:
    if ratio is None:
        return ""
    return f"{ratio['median']:.2f} ({ratio['min']:.2f} to {ratio['max']:.2f})"


# -- bars ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Bar:
    """What a figure should reach, and whether it did."""

    what: str
    bar: str
    value: float
    is_met: bool


def bars(document: dict[str, Any]) -> list[dict[str, Any]]:
    """Every bar that this run has the figures for."""
    found: list[Bar | None] = []
    tables = document["tables"]
    for add in (_small_bars, _latency_bars, _large_bars, _other_bars):
        found += add(tables)
    found += _rest_bars(document.get("rest", {}))
    return [
        {"what": bar.what, "bar": bar.bar, "value": bar.value, "is_met": bar.is_met}
        for bar in found
        if bar is not None
    ]


def _bar_lines(found: list[dict[str, Any]]) -> list[str]:
    if not found:
        return []
    lines = ["**Bars**", "", "| | bar | here | |", "|---|---|---|---|"]
    for bar in found:
        met = "met" if bar["is_met"] else "missed"
        lines.append(f"| {bar['what']} | {bar['bar']} | {amount(bar['value'])} | {met} |")
    return [*lines, ""]


def _value(tables: dict[str, Any], table: str, peer: str, key: str = "") -> float | None:
    row = tables.get(table, {}).get("peers", {}).get(peer)
    if row is None:
        return None
    figure = row["figures"].get(key) if key else row["value"]
    return figure["median"] if figure else None


def _over(tables: dict[str, Any], table: str, ours: str, theirs: str) -> float | None:
    """The median of the ratios of two peers, round by round."""
    peers = tables.get(table, {}).get("peers", {})
    if ours not in peers or theirs not in peers:
        return None
    pairs = zip(peers[ours]["rounds"], peers[theirs]["rounds"], strict=True)
    ratios = sorted(mine / other for mine, other in pairs if mine and other)
    return ratios[len(ratios) // 2] if ratios else None


def _best(tables: dict[str, Any], table: str, among: tuple[str, ...] = ()) -> str:
    """The best rival with protobuf; by name."""
    found = tables.get(table)
    if found is None:
        return ""
    rows = {
        name: row["value"]["median"]
        for name, row in found["peers"].items()
        if row["group"] == "rival"
        and row["value"]
        and not row["raw"]
        and not row["lost"]
        and (not among or name in among)
    }
    best: Callable[..., str] = max if found["is_better_larger"] else min
    return best(rows, key=rows.__getitem__) if rows else ""


def _at_least(what: str, value: float | None, bar: float) -> Bar | None:
    return None if value is None else Bar(what, f">= {bar:g}", value, value >= bar)


def _at_most(what: str, value: float | None, bar: float, unit: str = "") -> Bar | None:
    return None if value is None else Bar(what, f"<= {bar:g}{unit}", value, value <= bar)


def _small_bars(tables: dict[str, Any]) -> list[Bar | None]:
    tcp = _best(tables, "small", SPEAKS_TCP)
    fan = _best(tables, "fanout", SPEAKS_TCP)
    return [
        _at_least(
            f"small, TCP: ours / best rival ({tcp})", _over(tables, "small", "ours", tcp), 1.2
        ),
        _at_least(
            f"small, TCP: ours with uvloop / best rival ({tcp})",
            _over(tables, "small", "ours_uvloop", tcp),
            1.4,
        ),
        _at_least("small: ours / Zenoh", _over(tables, "small", "ours", "zenoh"), 1.6),
        _at_least("small: ours / tuned bare", _over(tables, "small", "ours", "tuned"), 0.85),
        _at_least(
            "small: blocking / asyncio", _over(tables, "small", "ours_blocking", "ours"), 0.7
        ),
        _at_least("small: ours, messages/s", _value(tables, "small", "ours"), 300_000),
        _at_least(
            f"1 to 8, TCP: ours / best rival ({fan})", _over(tables, "fanout", "ours", fan), 1.5
        ),
    ]


def _latency_bars(tables: dict[str, Any]) -> list[Bar | None]:
    tcp = _best(tables, "latency", SPEAKS_TCP)
    found = [
        _at_most("1 kHz p50: ours / bare", _over(tables, "latency", "ours", "buffered"), 1.25),
        _at_most(
            f"1 kHz p50: ours / best TCP rival ({tcp})", _over(tables, "latency", "ours", tcp), 1
        ),
    ]
    host = "ours_unix"
    for rival in ("iceoryx2", "lcm"):
        ratio = _over(tables, "latency", host, rival)
        found.append(_at_most(f"1 kHz p50: ours on one host / {rival}", ratio, 1))
    base = _value(tables, "latency", "buffered", "p99_us")
    if base is not None and base < 350:
        p99 = _value(tables, "latency", "ours", "p99_us")
        found.append(_at_most("1 kHz p99 (the bare one's is below)", p99, 350, " us"))
    return found


def _large_bars(tables: dict[str, Any]) -> list[Bar | None]:
    return [
        _at_least("1 MiB: ours / pyzmq raw", _over(tables, "mib", "ours", "zmq_raw"), 0.9),
        _at_most("6.2 MB p50, TCP", _value(tables, "image30", "ours"), 3.0, " ms"),
        _at_most("6.2 MB p50, shared memory", _value(tables, "image30", "ours_shm"), 1.8, " ms"),
        _at_most(
            "6.2 MB p50: shared memory / iceoryx2 raw",
            _over(tables, "image30", "ours_shm", "iceoryx2_raw"),
            1.8 / 1.6,
        ),
        _at_least("6.2 MB: rospy / ours", _over(tables, "image30", "rospy", "ours"), 5),
        _at_least("6.2 MB: Zenoh / ours", _over(tables, "image30", "zenoh", "ours"), 5),
    ]


def _other_bars(tables: dict[str, Any]) -> list[Bar | None]:
    call = _value(tables, "calls_sequential_p50_us", "ours", "paced_p50_us")
    one_way = _value(tables, "latency", "ours_unix")
    found = [
        _at_most("first message", _value(tables, "first", "ours"), 250, " ms"),
        _at_least(
            "100 calls at a time, calls/s",
            _value(tables, "calls_pipelined_per_second", "ours"),
            20_000,
        ),
    ]
    found += [
        _at_most(f"first message: ours / {rival}", _over(tables, "first", "ours", rival), 1)
        for rival in ("rospy", "rclpy_kilted")
    ]
    if call is not None and one_way is not None:
        found.append(_at_most("call at 1 kHz / one-way latency, same sockets", call / one_way, 2.2))
    return found


def _rest_bars(rest: dict[str, Any]) -> list[Bar | None]:
    return [
        _at_most("100 Hz timer and publisher", rest.get("publisher_percent"), 1, " % of a core"),
        _at_most("idle node", rest.get("idle_percent"), 0.1, " % of a core"),
        _at_most("memory of a node", rest.get("idle_rss_mb"), 60, " MB"),
    ]

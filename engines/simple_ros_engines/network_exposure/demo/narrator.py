"""What happens in the demo, in plain words: messages in, lines out. Pure but for messages.

Each line has a word that says what it is about, and a sentence.
"""

from __future__ import annotations

from dataclasses import dataclass

from simple_ros.msg.network_exposure_msgs import (
    FlowQos,
    FlowQosArray,
    Locator,
    QosAdvice,
    Throttle,
    UniqueTopicFlows,
)
from simple_ros.msg.turtlesim_msgs import AdaptationRequest, ControlStatus

__all__ = ["Line", "Narrator"]

_SAME = 0.1
_CALM_S = 2.5
"""What the maximizer turns notch by notch is told when it has stood for so long."""


@dataclass(frozen=True, slots=True)
class Line:
    """One happening.

    Attributes:
        word: What it is about.
        text: A sentence.
    """

    word: str
    text: str


@dataclass(slots=True)
class _Flow:
    """What was told of a flow."""

    state: str = ""
    qci: int = 0
    requests: int = 0
    told: int = 0
    begun_s: float | None = None
    trouble: str = ""


@dataclass(slots=True)
class _Knobs:
    """What the maximizer has made of a topic."""

    budget_ms: float = 0.0
    drop: int = 0
    changed_s: float = 0.0
    told: tuple[float, int] = (0.0, 0)


class Narrator:
    """Tells.

    Args:
        score_s: Scores are told so often.
    """

    def __init__(self, score_s: float = 10.0) -> None:
        self._score_s = score_s
        self._scored_s: float | None = None
        self._tagged: set[str] = set()
        self._ways: set[tuple[str, str, str]] = set()
        self._flows: dict[tuple[str, int], _Flow] = {}
        self._knobs: dict[str, _Knobs] = {}
        self._asked: dict[str, tuple[float, float]] = {}
        self._drives: dict[str, ControlStatus] = {}

    def relayed(self, message: UniqueTopicFlows) -> list[Line]:
        """A relay tells its flows."""
        lines = []
        for flow in message.flows:
            source, topic = flow.source_topic.strip("/"), flow.topic.strip("/")
            if source not in self._tagged:
                self._tagged.add(source)
                lines.append(Line("tag", f"{source} is relayed as {topic}"))
            way = (topic, _place(flow.source), _place(flow.destination))
            if way not in self._ways and flow.subscriber:
                self._ways.add(way)
                text = f"{topic}: TCP {way[1]} > {way[2]}, to {flow.subscriber.strip('/')}"
                lines.append(Line("flow", text))
        return lines

    def states(self, message: FlowQosArray, now_s: float) -> list[Line]:
        """The watcher tells what is asked of the network and what it gives."""
        where = " (simulated)" if message.is_simulated else ""
        lines = []
        for flow in message.flows:
            known = self._flows.setdefault((flow.topic.strip("/"), flow.source.port), _Flow())
            lines += self._state(known, flow, where, now_s)
        return lines

    def _state(self, known: _Flow, flow: FlowQos, where: str, now_s: float) -> list[Line]:
        before, known.state = known.state, flow.state
        topic, lines = flow.topic.strip("/"), []
        if flow.requests > known.requests:
            # Of what was under way before anybody listened it is not known how long it took.
            known.begun_s = now_s if before or flow.state == "requesting" else None
            known.requests = flow.requests
        if flow.requests > known.told and flow.qci and flow.state in ("pending", "active"):
            lines.append(Line("request", f"{topic} {_needs(flow, known.qci)}"))
            known.told, known.qci = flow.requests, flow.qci
        if flow.state == "active" and (known.begun_s is not None or not before):
            took = "" if known.begun_s is None else f" after {now_s - known.begun_s:.1f} s"
            lines.append(Line("bearer", f"{topic}: QCI {flow.qci} is set up{took}{where}"))
            known.begun_s, known.trouble = None, ""
        elif flow.state == before:
            return lines
        elif flow.state == "degraded":
            gets = f"gets QCI {flow.applied_qci}" if flow.applied_qci else "gets less"
            lines.append(Line("downgrade", f"{topic} {gets} instead of {flow.qci}{where}"))
        elif flow.state == "failed" and flow.detail != known.trouble:
            known.trouble = flow.detail
            word = "refused" if flow.is_refused else "failed"
            lines.append(Line(word, f"{topic}: {_short(flow.detail)}"))
        return lines

    def advised(self, message: QosAdvice, now_s: float) -> None:
        """The maximizer asks for a latency budget; told by `tick`."""
        budget_ms = 0.0 if message.clear else message.latency_budget_ms
        known = self._knobs.setdefault(message.topic.strip("/"), _Knobs())
        if abs(budget_ms - known.budget_ms) > _SAME * known.budget_ms:
            known.budget_ms, known.changed_s = budget_ms, now_s

    def throttled(self, message: Throttle, now_s: float) -> None:
        """The maximizer leaves out messages; told by `tick`."""
        known = self._knobs.setdefault(message.topic.strip("/"), _Knobs())
        if message.drop_every_nth != known.drop:
            known.drop, known.changed_s = message.drop_every_nth, now_s

    def asked(self, message: AdaptationRequest) -> list[Line]:
        """An application is asked to adapt."""
        wanted = (message.speed_factor, message.rate_factor)
        if self._asked.get(message.group, (1.0, 1.0)) == wanted:
            return []
        self._asked[message.group] = wanted
        why = f" ({_short(message.reason)})" if message.reason else ""
        if wanted == (1.0, 1.0):
            return [Line("adapt", f"{message.group} may be as fast as it was made for{why}")]
        speed, rate = (f"{100 * factor:.0f} %" for factor in wanted)
        return [
            Line(
                "adapt",
                f"{message.group} is asked for {speed} of its speed, {rate} of its rate{why}",
            )
        ]

    def drives(self, message: ControlStatus) -> list[Line]:
        """A controller tells how it gets on."""
        before = self._drives.get(message.turtle)
        self._drives[message.turtle] = message
        if before is None or (before.speed_factor, before.control_rate) == (
            message.speed_factor,
            message.control_rate,
        ):
            return []
        speed = message.wanted_speed * message.speed_factor
        return [
            Line(
                "turtle",
                f"{message.turtle} drives at {speed:.2f} m/s with {message.control_rate:g} commands a second now",
            )
        ]

    def tick(self, now_s: float) -> list[Line]:
        """What is told after a while."""
        lines = [
            Line("maximizer", f"{topic}: {_eased(known)}")
            for topic, known in self._knobs.items()
            if self._is_calm(known, now_s)
        ]
        scores = {name: one.mos for name, one in sorted(self._drives.items()) if one.mos > 0}
        if scores and self._scored_s is None:
            self._scored_s = now_s
        if self._scored_s is not None and now_s - self._scored_s >= self._score_s:
            self._scored_s = now_s
            lines.append(
                Line("MOS", ", ".join(f"{name} {score:.1f}" for name, score in scores.items()))
            )
        return lines

    @staticmethod
    def _is_calm(known: _Knobs, now_s: float) -> bool:
        budget_ms, drop = known.told
        is_same = known.drop == drop and abs(known.budget_ms - budget_ms) <= _SAME * budget_ms
        if is_same or now_s - known.changed_s < _CALM_S:
            return False
        known.told = (known.budget_ms, known.drop)
        return True


def _place(locator: Locator) -> str:
    address = f"[{locator.address}]" if ":" in locator.address else locator.address
    return f"{address}:{locator.port}"


def _needs(flow: FlowQos, before: int) -> str:
    """What is asked for a flow."""
    needs = f"{flow.delay_budget_ms:.0f} ms, loss below {flow.error_rate:g}"
    if flow.is_gbr:
        needs += f", {flow.bit_rate / 1000:.0f} kbit/s reserved"
    asks = f"needs {needs}: QCI {flow.qci}"
    if before and before != flow.qci:
        return f"{asks} instead of {before}"
    if flow.is_unmet:
        return f"{asks}, which misses it least"
    others = ", ".join(map(str, flow.alternatives))
    return f"{asks}, else {others}" if others and not before else asks


def _short(detail: str) -> str:
    """What the network said, without how it was asked."""
    return detail.partition("refused with ")[2] or detail


def _eased(known: _Knobs) -> str:
    """What the maximizer does to a topic."""
    parts = []
    if known.budget_ms:
        parts.append(f"{known.budget_ms:.0f} ms will do")
    if known.drop:
        parts.append(f"one message in {known.drop} is left out")
    return ", ".join(parts) or "what it needs by itself is asked for"

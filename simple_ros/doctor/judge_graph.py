"""Does the Master answer, and does what it knows hold together?"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

from simple_ros.doctor.findings import Finding, error, ok, warning
from simple_ros.graph import GraphSnapshot

__all__ = [
    "Master",
    "MasterKind",
    "NodeAnswer",
    "Offer",
    "Surroundings",
    "judge_graph",
    "judge_master",
    "most_links",
]

_SLOW_MASTER_MS = 50.0
_SHOWN = 8


class MasterKind(Enum):
    """Whose Master it is."""

    OURS = "ours"
    CPP = "C++"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Master:
    """What was found out about the Master.

    Attributes:
        address: Where it was looked for.
        problem: Why it was not found; empty if it was.
        hint: What may be done about the problem.
        kind: Whose it is.
        version: Its version; C++ Masters tell none.
        own_version: Version of simple-ros here.
        connect_ms: How long it took to connect.
        round_trips_ms: How long calls took.
        is_local: Whether it is on this host; None if unknown.
    """

    address: str
    problem: str = ""
    hint: str = ""
    kind: MasterKind = MasterKind.UNKNOWN
    version: str = ""
    own_version: str = ""
    connect_ms: float = 0.0
    round_trips_ms: tuple[float, ...] = ()
    is_local: bool | None = None


def judge_master(found: Master) -> list[Finding]:
    """All findings about the Master itself."""
    if found.problem:
        return [error("master", found.problem, found.hint)]
    findings = [ok("master", f"answers at {found.address}"), _version(found)]
    if found.round_trips_ms:
        findings.append(_round_trip(found))
    return findings


def _version(found: Master) -> Finding:
    check = "master version"
    if found.kind is MasterKind.CPP:
        return ok(
            check,
            "C++ simple_ros, which tells no version; it keeps dead nodes and notices no conflicts",
        )
    if found.kind is MasterKind.UNKNOWN:
        return warning(check, "it did not tell whether it is ours within the time it had")
    if found.version != found.own_version:
        return warning(
            check,
            f"the Master is simple-ros {found.version}, this is {found.own_version}",
            "install the same version on all hosts and start the Master again",
        )
    return ok(check, f"simple-ros {found.version}, as here")


def _round_trip(found: Master) -> Finding:
    # The fastest: the others also measure what else this host was doing.
    best, worst = min(found.round_trips_ms), max(found.round_trips_ms)
    text = (
        f"{best:.2f} ms (fastest of {len(found.round_trips_ms)}, slowest {worst:.2f} ms), "
        f"connected in {found.connect_ms:.2f} ms"
    )
    if best > _SLOW_MASTER_MS:
        return warning(
            "round trip", text, "look at the network, or at what loads the Master's host"
        )
    return ok("round trip", text)


@dataclass(frozen=True, slots=True)
class NodeAnswer:
    """What came of connecting to a node.

    Attributes:
        name: Of the node.
        address: Where the Master says it listens.
        problem: Why no connection stood; empty if one did, or if there was no time to try.
        refused: Whether its host answered that nobody listens.
        elsewhere: Another address of the node where it did answer.
        was_tried: Whether there was time to try.
        has_lease: Whether the Master would notice its end (nodes of ours).
        is_misplaced: It is listed with a loopback address although the Master is on another host.
    """

    name: str
    address: str
    problem: str = ""
    refused: bool = False
    elsewhere: str = ""
    was_tried: bool = True
    has_lease: bool = False
    is_misplaced: bool = False


@dataclass(frozen=True, slots=True)
class Offer:
    """A publisher whose offer falls short of a subscriber's request."""

    topic: str
    publisher: str
    subscriber: str
    policies: str


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The graph, and what asking around in it brought.

    Attributes:
        graph: Without this doctor.
        answers: One for each node.
        offers: Pairs whose QoS does not fit.
        topics_asked: How many topics were asked about, and how many there were to ask; None for a Master
            that knows no QoS.
    """

    graph: GraphSnapshot
    answers: tuple[NodeAnswer, ...]
    offers: tuple[Offer, ...]
    topics_asked: tuple[int, int] | None


def judge_graph(found: Surroundings) -> list[Finding]:
    """All findings about what the Master knows."""
    return [
        *_answers(found.answers, forgets=found.topics_asked is not None),
        *_types(found.graph),
        *_offers(found.offers, found.topics_asked),
    ]


def _answers(answers: Sequence[NodeAnswer], *, forgets: bool) -> Iterator[Finding]:
    good = [answer for answer in answers if answer.was_tried and not answer.problem]
    bad = [answer for answer in answers if answer.problem]
    for answer in bad:
        yield _silent(answer, forgets=forgets)
    for answer in good:
        if answer.elsewhere:
            yield warning(
                "node",
                f"{answer.name} does not answer at {answer.address}, but at {answer.elsewhere}",
                "C++ nodes only know the first address; look at the route and at firewalls",
            )
    untried = [answer.name for answer in answers if not answer.was_tried]
    if untried:
        yield warning("nodes", f"no time to try {len(untried)} of {len(answers)}: {_some(untried)}")
    if good or not answers:
        yield ok(
            "nodes",
            f"{len(good)} of {len(answers)} take connections{_listed([a.name for a in good])}",
        )


def _silent(answer: NodeAnswer, *, forgets: bool) -> Finding:
    text = f"{answer.name} is listed at {answer.address}, but {answer.problem}"
    if answer.is_misplaced:
        return error(
            "node",
            f"{text} (that address only means its own host)",
            "start it with SIMPLE_ROS_MASTER set to the Master's address, not to localhost",
        )
    if not answer.refused:
        return error("node", text, "look for a firewall, a lost link or a host that is off")
    if answer.has_lease:
        return error("node", text, "it runs without listening: start it again")
    forgetting = (
        "the Master drops it within seconds" if forgets else "its C++ Master never drops it"
    )
    return error("node", f"{text}: it is dead", f"start it again; {forgetting}")


def _types(graph: GraphSnapshot) -> Iterator[Finding]:
    users: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for node in graph.nodes:
        for key in dict.fromkeys((*node.publishes, *node.subscribes)):
            users[key.topic][key.msg_type].append(node.name)
    conflicts = {topic: types for topic, types in users.items() if len(types) > 1}
    for topic, types in sorted(conflicts.items()):
        listed = ", ".join(
            f"{msg_type} ({_some(names)})" for msg_type, names in sorted(types.items())
        )
        yield error(
            "types",
            f"topic {topic!r} has {len(types)} message types: {listed}; these nodes do not hear each other",
            "let all use one type, or give one of them another topic",
        )
    if not conflicts:
        yield ok("types", f"{_topics(len(users))}, each of one type")


def _offers(offers: Sequence[Offer], asked: tuple[int, int] | None) -> Iterator[Finding]:
    for offer in offers:
        yield error(
            "QoS",
            f"no messages on {offer.topic!r} from {offer.publisher} to {offer.subscriber}: {offer.policies}",
            "let the publisher offer more or the subscriber request less",
        )
    if asked is None:
        yield ok("QoS", "a C++ Master knows none")
    elif asked[0] < asked[1]:
        yield warning(
            "QoS", f"only {asked[0]} of {asked[1]} topics were examined in the time there was"
        )
    elif not offers:
        yield ok("QoS", f"{_topics(asked[1])} with publishers and subscribers: all fit")


def _topics(count: int) -> str:
    return f"{count} topic{'' if count == 1 else 's'}"


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more


def _listed(names: Sequence[str]) -> str:
    return f": {_some(names)}" if names else ""


def most_links(graph: GraphSnapshot) -> tuple[str, int]:
    """The node with the most links to others, and how many those are."""
    links: dict[str, int] = defaultdict(int)
    for edge in graph.edges:
        links[edge.src] += 1
        links[edge.dst] += 1
    return max(links.items(), key=lambda item: (item[1], item[0]), default=("", 0))

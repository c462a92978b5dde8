"""Verdicts on a Master and what it knows."""

from dataclasses import replace

import pytest

from simple_ros.doctor.findings import Finding, Level, report_json, report_lines, summary
from simple_ros.doctor.judge_graph import (
    Master,
    MasterKind,
    NodeAnswer,
    Offer,
    Surroundings,
    judge_graph,
    judge_master,
    most_links,
)
from simple_ros.graph import GraphNode, GraphSnapshot, TopicKey, edges_between

MASTER = Master(
    "robot:50051",
    kind=MasterKind.OURS,
    version="1.0",
    own_version="1.0",
    connect_ms=0.3,
    round_trips_ms=(0.5, 9.0, 0.7),
)
CALM = Surroundings(GraphSnapshot(), (), (), (0, 0))
NODE = NodeAnswer("base", "10.0.0.3:4000")


def bad(findings: list[Finding]) -> list[tuple[Level, str]]:
    assert all(found.fix for found in findings if found.level is Level.ERROR)
    return [(found.level, found.text) for found in findings if found.level is not Level.OK]


class TestMaster:
    def test_good(self):
        findings = judge_master(MASTER)
        assert bad(findings) == []
        assert findings[-1].text.startswith("0.50 ms (fastest of 3, slowest 9.00 ms)")

    def test_none(self):
        (found,) = judge_master(Master("x:1", problem="nobody", hint="start one"))
        assert (found.level, found.text, found.fix) == (Level.ERROR, "nobody", "start one")

    @pytest.mark.parametrize(
        ("changes", "text"),
        [
            ({"version": "0.9"}, "the Master is simple-ros 0.9, this is 1.0"),
            ({"round_trips_ms": (80.0, 90.0)}, "80.00 ms"),
            ({"kind": MasterKind.UNKNOWN}, "did not tell"),
        ],
    )
    def test_warnings(self, changes, text):
        ((level, found),) = bad(judge_master(replace(MASTER, **changes)))
        assert level is Level.WARNING
        assert text in found

    def test_cpp(self):
        findings = judge_master(replace(MASTER, kind=MasterKind.CPP, version=""))
        assert bad(findings) == []
        assert "tells no version" in findings[1].text


class TestNodes:
    def judged(self, *answers: NodeAnswer) -> list[Finding]:
        return judge_graph(replace(CALM, answers=answers))

    def test_all_answer(self):
        assert bad(self.judged(NODE)) == []
        assert self.judged(NODE)[0].text == "1 of 1 take connections: base"

    @pytest.mark.parametrize(
        ("changes", "text", "fix"),
        [
            (
                {"problem": "nobody listens", "refused": True},
                "it is dead",
                "drops it within seconds",
            ),
            (
                {"problem": "nobody listens", "refused": True, "has_lease": True},
                "nobody listens",
                "without listening",
            ),
            ({"problem": "no answer within 1 s"}, "10.0.0.3:4000, but no answer", "firewall"),
            (
                {"problem": "nobody listens", "refused": True, "is_misplaced": True},
                "only means its own host",
                "SIMPLE_ROS_MASTER",
            ),
        ],
    )
    def test_one_does_not(self, changes, text, fix):
        (found,) = (
            one for one in self.judged(replace(NODE, **changes)) if one.level is Level.ERROR
        )
        assert text in found.text
        assert fix in found.fix + found.text

    def test_a_cpp_master_keeps_the_dead(self):
        dead = replace(NODE, problem="nobody listens", refused=True)
        (found,) = (
            one
            for one in judge_graph(replace(CALM, answers=(dead,), topics_asked=None))
            if one.level is Level.ERROR
        )
        assert found.fix == "start it again; its C++ Master never drops it"

    def test_answers_elsewhere(self):
        assert bad(self.judged(replace(NODE, elsewhere="10.1.0.3:4000"))) == [
            (Level.WARNING, "base does not answer at 10.0.0.3:4000, but at 10.1.0.3:4000")
        ]

    def test_no_time(self):
        untried = tuple(NodeAnswer(f"n{i}", "", was_tried=False) for i in range(12))
        ((level, text),) = bad(self.judged(NODE, *untried))
        assert level is Level.WARNING
        assert text.endswith("n6, n7 and 4 more")


class TestTopics:
    def test_two_types(self):
        nodes = (
            GraphNode("a", publishes=(TopicKey("data", "x.A"),)),
            GraphNode("b", subscribes=(TopicKey("data", "x.B"),)),
        )
        ((level, text),) = bad(judge_graph(replace(CALM, graph=GraphSnapshot(nodes))))
        assert level is Level.ERROR
        assert "topic 'data' has 2 message types: x.A (a), x.B (b)" in text

    def test_an_offer_that_does_not_fit(self):
        offer = Offer("map", "server", "view", "durability offered volatile, requested latched")
        ((level, text),) = bad(judge_graph(replace(CALM, offers=(offer,), topics_asked=(1, 1))))
        assert level is Level.ERROR
        assert text.startswith("no messages on 'map' from server to view: durability")

    def test_not_all_were_asked(self):
        assert bad(judge_graph(replace(CALM, topics_asked=(3, 9)))) == [
            (Level.WARNING, "only 3 of 9 topics were examined in the time there was")
        ]

    def test_a_cpp_master_knows_no_qos(self):
        assert bad(judge_graph(replace(CALM, topics_asked=None))) == []


def test_the_busiest_node():
    key = TopicKey("t", "x.A")
    nodes = (
        GraphNode("hub", publishes=(key,)),
        GraphNode("p", subscribes=(key,)),
        GraphNode("q", subscribes=(key,)),
    )
    assert most_links(GraphSnapshot(nodes, edges_between(nodes))) == ("hub", 2)
    assert most_links(GraphSnapshot()) == ("", 0)


class TestReport:
    FINDINGS = (
        Finding("a", Level.OK, "fine"),
        Finding("b", Level.WARNING, "odd\x1b[2J", "look"),
        Finding("c", Level.ERROR, "broken", "mend it"),
    )

    def test_lines(self):
        assert [line for _, line in report_lines(self.FINDINGS, verbose=False)] == [
            "warning  b: odd\\x1b[2J",
            "         fix: look",
            "error    c: broken",
            "         fix: mend it",
        ]
        assert report_lines(self.FINDINGS, verbose=True)[0] == (Level.OK, "ok       a: fine")
        assert summary(self.FINDINGS) == "3 findings: 1 ok, 1 warning, 1 error"

    def test_json(self):
        report = report_json(self.FINDINGS)
        assert (report["ok"], report["warnings"], report["errors"]) == (1, 1, 1)
        assert report["findings"][2] == {
            "check": "c", "level": "error", "text": "broken", "fix": "mend it",
        }  # fmt: skip

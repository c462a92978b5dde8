"""The demo without programs: what happens to the network and when, and what is told of it."""

from __future__ import annotations

import pytest

from simple_ros.msg.network_exposure_msgs import (
    FlowQos,
    FlowQosArray,
    Locator,
    QosAdvice,
    Throttle,
    UniqueTopicFlow,
    UniqueTopicFlows,
)
from simple_ros.msg.turtlesim_msgs import AdaptationRequest, ControlStatus
from simple_ros_engines.network_exposure.demo.narrator import Line, Narrator
from simple_ros_engines.network_exposure.demo.story import WINDOW_S, Act, Pacing, Story
from simple_ros_engines.network_exposure.qci import qos_class

PACING = Pacing(10.0)
TOPICS = frozenset({"turtle1/pose", "turtle1/cmd_vel", "turtle2/pose"})


def flows(state: str = "active", **qcis: int) -> FlowQosArray:
    """All topics with sessions, of class 83 unless said otherwise (``turtle1_pose=84``)."""
    told = FlowQosArray(is_simulated=True)
    for topic in sorted(TOPICS):
        qci = qcis.get(topic.replace("/", "_"), 83)
        row = qos_class(qci)
        assert row is not None
        told.flows.add(
            topic=topic, state=state, qci=qci, session_id="s", delay_budget_ms=row.delay_ms
        )
    return told


def words(lines: list[Line]) -> list[tuple[str, str]]:
    return [(line.word, line.text) for line in lines]


# -- the story ---------------------------------------------------------------------------------------


def test_the_usual_pace_gives_a_step_the_time_it_takes() -> None:
    usual = Pacing()
    assert (usual.dwell_s, usual.period_s, usual.settle_s, usual.patience_s) == (5, 1, 8, 30)


@pytest.mark.parametrize("setup_s", [0.3, 2.0, 40.0])
@pytest.mark.parametrize("pace_s", [0.1, 3.0, 15.0, 60.0])
def test_nobody_is_slowed_down_while_a_lower_request_is_still_under_way(
    pace_s: float, setup_s: float
) -> None:
    pacing = Pacing(pace_s, setup_s)
    assert pacing.settle_s > pacing.dwell_s + setup_s
    assert pacing.patience_s > WINDOW_S + pacing.dwell_s + setup_s
    assert pacing.calm_s > pacing.dwell_s


def test_it_begins_when_all_is_served() -> None:
    story = Story(TOPICS, PACING)
    assert story.tick(0.0) is None
    story.flows_are(flows("pending"))
    assert story.tick(50.0) is None
    story.flows_are(flows())
    step = story.tick(60.0)
    assert step is not None
    assert (step.act, step.least_delay_ms) == (Act.AT_EASE, 0)


@pytest.mark.parametrize(("score", "begins_s"), [(4.8, 63.0), (3.0, 80.0)])
def test_the_maximizer_waits_for_good_scores_but_not_for_ever(
    score: float, begins_s: float
) -> None:
    story = Story(TOPICS, PACING)
    story.flows_are(flows())
    story.scored("turtle1", 4.9)
    story.scored("turtle2", 1.0)
    assert story.tick(60.0) is None
    story.scored("turtle2", score)
    assert (story.tick(63.0) is not None) == (begins_s == 63.0)
    if begins_s > 63.0:
        assert story.tick(79.9) is None
        assert story.tick(begins_s) is not None


def test_it_loads_the_cell_twice_lets_it_recover_and_begins_again() -> None:
    story = Story(TOPICS, PACING)
    story.flows_are(flows(turtle1_cmd_vel=84, turtle2_pose=84))
    story.tick(0.0)
    story.eased(3.0)
    assert story.tick(9.9) is None
    story.eased(5.6)
    assert story.tick(10.9) is None
    step = story.tick(11.0)
    # The tightest class has 10 ms.
    assert step is not None
    assert (step.act, step.least_delay_ms) == (Act.SHORT, 11)
    story.flows_are(flows("degraded"))
    assert story.tick(25.0) is None, "a lower request is not served yet"
    story.flows_are(flows(turtle1_pose=75, turtle1_cmd_vel=71, turtle2_pose=71))
    step = story.tick(26.0)
    assert step is not None
    assert (step.act, step.least_delay_ms) == (Act.SHORTER, 51)
    story.flows_are(flows(turtle1_pose=1, turtle1_cmd_vel=74, turtle2_pose=74))
    step = story.tick(36.0)
    assert step is not None, "nobody drives slower yet"
    assert (step.act, step.least_delay_ms) == (Act.SHORTER, 101)
    story.slowed("turtle1", is_slowed=True)
    step = story.tick(46.0)
    assert step is not None
    assert (step.act, step.least_delay_ms) == (Act.RECOVERED, 0)
    story.slowed("turtle1", is_slowed=False)
    assert story.tick(60.0) is None, "requests are still the lower ones"
    assert story.rounds == 0
    story.flows_are(flows(turtle1_cmd_vel=84, turtle2_pose=84))
    step = story.tick(61.0)
    assert step is not None
    assert (step.act, story.rounds) == (Act.SHORT, 1)


@pytest.mark.parametrize(
    ("before", "less", "again"),
    [
        # A class of the short time in which a rate is not steady.
        ((80, 48.0), (75, 64.0), (84, 49.3)),
        # A need of 75 ms was served by what had been asked for one of 50 ms.
        ((84, 50.0), (71, 200.0), (84, 75.0)),
    ],
)
def test_who_asks_for_as_much_as_before_is_back(
    before: tuple[int, float], less: tuple[int, float], again: tuple[int, float]
) -> None:
    story = Story(TOPICS, PACING)
    asked = flows(turtle1_pose=84)
    for flow in asked.flows:
        flow.qci, flow.delay_budget_ms = before
    story.flows_are(asked)
    story.tick(0.0)
    story.eased(0.0)
    for now_s, act in ((20.0, Act.SHORT), (40.0, Act.SHORTER)):
        step = story.tick(now_s)
        assert step is not None
        assert step.act is act
        story.slowed("turtle1", is_slowed=True)
    assert story.tick(60.0) is not None
    story.slowed("turtle1", is_slowed=False)
    for now, is_over in ((less, False), (again, True)):
        for flow in asked.flows:
            flow.qci, flow.delay_budget_ms = now
        story.flows_are(asked)
        assert (story.tick(80.0) is not None) == is_over


def test_what_does_not_happen_ends_no_story() -> None:
    story = Story(TOPICS, PACING)
    story.flows_are(flows())
    story.tick(0.0)
    assert story.tick(100.0) is None, "the maximizer has not done anything"
    story.eased(0.0)
    story.flows_are(flows("failed"))
    assert story.tick(199.0) is None
    step = story.tick(200.0)
    assert step is not None
    assert step.act is Act.SHORT


# -- what is told ------------------------------------------------------------------------------------


def test_tags_and_flows_are_told_once() -> None:
    flow = UniqueTopicFlow(
        topic="turtle1/pose",
        source_topic="turtle1/pose_qos",
        subscriber="/turtle1_controller",
        source=Locator(address="127.0.0.1", port=1),
        destination=Locator(address="::1", port=2),
    )
    narrator = Narrator()
    assert words(narrator.relayed(UniqueTopicFlows(flows=[flow]))) == [
        ("tag", "turtle1/pose_qos is relayed as turtle1/pose"),
        ("flow", "turtle1/pose: TCP 127.0.0.1:1 > [::1]:2, to turtle1_controller"),
    ]
    assert not narrator.relayed(UniqueTopicFlows(flows=[flow]))


def one(**fields: object) -> FlowQosArray:
    base = {
        "topic": "turtle1/pose",
        "qci": 83,
        "delay_budget_ms": 16.0,
        "error_rate": 0.01,
        "bit_rate": 62_500.0,
        "is_gbr": True,
        "requests": 1,
    }
    flow = FlowQos(**(base | fields))  # type: ignore[arg-type]
    return FlowQosArray(is_simulated=True, flows=[flow])


def test_a_flow_is_told_from_its_request_to_its_downgrade_and_lower_request() -> None:
    narrator = Narrator()
    assert not narrator.states(one(state="waiting", requests=0), 0.0)
    assert not narrator.states(one(state="requesting", alternatives=[82, 85]), 1.0)
    assert words(narrator.states(one(state="pending", alternatives=[82, 85]), 1.1)) == [
        (
            "request",
            "turtle1/pose needs 16 ms, loss below 0.01, 62 kbit/s reserved: QCI 83, else 82, 85",
        )
    ]
    assert words(narrator.states(one(state="active"), 3.0)) == [
        ("bearer", "turtle1/pose: QCI 83 is set up after 2.0 s (simulated)")
    ]
    assert words(narrator.states(one(state="degraded", applied_qci=9), 9.0)) == [
        ("downgrade", "turtle1/pose gets QCI 9 instead of 83 (simulated)")
    ]
    assert not narrator.states(one(state="degraded", applied_qci=9), 9.5)
    refused = {"is_refused": True, "detail": "PUT /x: refused with 403: no room"}
    told = narrator.states(one(state="failed", requests=2, **refused), 10.0)
    assert words(told) == [("refused", "turtle1/pose: 403: no room")]
    assert not narrator.states(one(state="requesting", requests=3), 11.0)
    assert not narrator.states(one(state="failed", requests=3, **refused), 11.0)
    lower = one(state="pending", requests=4, qci=84, delay_budget_ms=32.0, is_gbr=False)
    assert words(narrator.states(lower, 12.0)) == [
        ("request", "turtle1/pose needs 32 ms, loss below 0.01: QCI 84 instead of 83")
    ]


def test_how_long_it_took_is_not_said_of_what_nobody_saw_begin() -> None:
    told = words(Narrator().states(one(state="active"), 3.0))
    assert told[-1] == ("bearer", "turtle1/pose: QCI 83 is set up (simulated)")


def test_what_cannot_be_met_is_said() -> None:
    (line,) = Narrator().states(one(state="pending", is_unmet=True), 0.0)
    assert line.text.endswith("QCI 83, which misses it least")


def test_what_the_maximizer_turns_is_told_when_it_stands() -> None:
    narrator = Narrator()
    narrator.advised(QosAdvice(topic="/turtle1/pose", latency_budget_ms=24), 0.0)
    narrator.throttled(Throttle(topic="turtle1/pose", drop_every_nth=8), 1.0)
    assert not narrator.tick(3.0)
    assert words(narrator.tick(3.6)) == [
        ("maximizer", "turtle1/pose: 24 ms will do, one message in 8 is left out")
    ]
    narrator.advised(QosAdvice(topic="/turtle1/pose", latency_budget_ms=25), 4.0)
    assert not narrator.tick(60.0), "that is the same"
    narrator.advised(QosAdvice(topic="/turtle1/pose", clear=True), 61.0)
    narrator.throttled(Throttle(topic="turtle1/pose"), 61.0)
    assert words(narrator.tick(70.0)) == [
        ("maximizer", "turtle1/pose: what it needs by itself is asked for")
    ]


def test_adaptation_is_told_when_it_changes_and_what_comes_of_it() -> None:
    narrator = Narrator()
    ask = AdaptationRequest(
        group="turtle1", speed_factor=0.5, rate_factor=0.5, reason="PUT: refused with 403: full"
    )
    assert words(narrator.asked(ask)) == [
        ("adapt", "turtle1 is asked for 50 % of its speed, 50 % of its rate (403: full)")
    ]
    assert not narrator.asked(ask)
    fast = ControlStatus(turtle="turtle1", wanted_speed=1, speed_factor=1, control_rate=20, mos=4.9)
    slow = ControlStatus(
        turtle="turtle1", wanted_speed=1, speed_factor=0.5, control_rate=10, mos=3.0
    )
    assert not narrator.drives(fast)
    assert words(narrator.drives(slow)) == [
        ("turtle", "turtle1 drives at 0.50 m/s with 10 commands a second now")
    ]
    assert not narrator.drives(slow)
    ask = AdaptationRequest(group="turtle1", speed_factor=1, rate_factor=1)
    assert words(narrator.asked(ask)) == [("adapt", "turtle1 may be as fast as it was made for")]


@pytest.mark.parametrize("score_s", [5.0, 10.0])
def test_scores_are_told_now_and_then(score_s: float) -> None:
    narrator = Narrator(score_s)
    assert not narrator.tick(0.0)
    for turtle, mos in (("turtle2", 3.04), ("turtle1", 4.9), ("turtle3", 0.0)):
        narrator.drives(ControlStatus(turtle=turtle, mos=mos))
    assert not narrator.tick(100.0)
    assert not narrator.tick(100.0 + score_s - 0.1)
    assert words(narrator.tick(100.0 + score_s)) == [("MOS", "turtle1 4.9, turtle2 3.0")]

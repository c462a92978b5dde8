"""The network as consumer, without a network: requests to adapt, what is exposed, what the network may ask."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from simple_ros_engines.network_exposure.exposure.model import ApiMalformed
from simple_ros_engines.network_exposure.exposure.schema import problems
from simple_ros_engines.network_exposure.mock.core import (
    Admission,
    Bearer,
    BearerState,
    MockNetwork,
    MockSettings,
)
from simple_ros_engines.network_exposure.mock.services import BadBody, Desk
from simple_ros_engines.network_exposure.mock.vaseal_api import VasealApi
from simple_ros_engines.network_exposure.mos.judgements import Judge
from simple_ros_engines.network_exposure.turtlesim.adaptation import Adaptations, is_meant
from simple_ros_engines.network_exposure.vaseal.bodies import APPLICATION, Wish, wish_of
from simple_ros_engines.network_exposure.vaseal.exposed import Exposed, FlowState
from simple_ros_engines.store.http import Request

OWN = ("turtle1/pose", "turtle1/cmd_vel")


class TestAdaptations:
    def test_nobody_asks(self) -> None:
        asked = Adaptations()
        assert (asked.speed(0.0), asked.rate(0.0), asked.reason(0.0)) == (1.0, 1.0, "")

    def test_the_slowest_counts_and_nobody_undoes_what_another_needs(self) -> None:
        asked = Adaptations()
        asked.came("maximizer", 0.5, 0.5, 0.0, 0.0, "downgraded")
        asked.came("network", 0.25, 0.0, 0.0, 0.0, "a concert")
        assert (asked.speed(1.0), asked.rate(1.0)) == (0.25, 0.5)
        assert asked.reason(1.0) == "downgraded; a concert"
        asked.came("maximizer", 1.0, 1.0, 0.0, 2.0)
        assert (asked.speed(2.0), asked.rate(2.0)) == (0.25, 1.0)
        asked.came("network", 1.0, 1.0, 0.0, 3.0)
        assert (asked.speed(3.0), asked.rate(3.0)) == (1.0, 1.0)

    def test_a_requester_that_dies_is_forgotten(self) -> None:
        asked = Adaptations()
        asked.came("maximizer", 0.5, 0.5, 6.0, 0.0)
        assert asked.rate(5.9) == 0.5
        asked.came("maximizer", 0.5, 0.5, 6.0, 5.9)
        assert asked.rate(11.0) == 0.5
        assert (asked.rate(12.0), asked.speed(12.0)) == (1.0, 1.0)

    def test_zero_leaves_it_as_it_is_and_a_policy_may_ask_for_more(self) -> None:
        asked = Adaptations()
        asked.came("maximizer", 2.0, 0.0, 0.0, 0.0)
        asked.came("maximizer", 0.0, 0.5, 0.0, 1.0)
        assert (asked.speed(2.0), asked.rate(2.0)) == (2.0, 0.5)
        asked.came("network", 0.5, 0.5, 0.0, 2.0)
        assert asked.speed(2.0) == 0.5

    def test_nonsense_changes_nothing(self) -> None:
        asked = Adaptations()
        asked.came("a", 0.5, 0.5, 0.0, 0.0)
        for speed, rate, valid_s in ((math.nan, 1, 0), (1, -1, 0), (1, 1, math.inf)):
            assert not asked.came("a", speed, rate, valid_s, 1.0)
        assert (asked.speed(1.0), asked.rate(1.0)) == (0.5, 0.5)
        asked.came("b", 1e-9, 1e9, 0.0, 1.0)
        assert (asked.speed(1.0), asked.rate(1.0)) == (0.05, 0.5)

    def test_many_requesters_are_too_many(self) -> None:
        asked = Adaptations()
        for number in range(1000):
            asked.came(f"{number}", 0.5, 0.5, 0.0, 0.0, "x")
        assert asked.reason(0.0).count("x") == 64

    @pytest.mark.parametrize(
        ("group", "topics", "is_for_it"),
        [
            ("", (), True),
            ("turtle1", (), True),
            ("turtle2", (), False),
            ("turtle2", ("/turtle1/pose",), True),
            ("", ("turtle2/pose",), False),
        ],
    )
    def test_who_is_meant(self, group: str, topics: tuple[str, ...], is_for_it: bool) -> None:
        assert is_meant(group, topics, "turtle1", OWN) is is_for_it


class TestExposed:
    def exposed(self) -> Exposed:
        exposed = Exposed()
        exposed.scored("turtle1", ("/turtle1/pose", "/turtle1/cmd_vel"), 4.9, Judge.AUTOMATIC, 0.0)
        return exposed

    def test_what_is_told(self) -> None:
        exposed = self.exposed()
        exposed.flows_are(
            [FlowState("turtle1/pose", "degraded", 83, 9), FlowState("other", "active")]
        )
        exposed.asked("turtle1", (), "maximizer", (0.5, 0.5), 0.0, 1.0)
        told = exposed.reports(1.0, 10.0)
        assert told["turtle1"] == {
            "group": "turtle1",
            "topics": list(OWN),
            "speedFactor": 0.5,
            "rateFactor": 0.5,
            "flows": [{"topic": "turtle1/pose", "state": "degraded", "qci": 83, "appliedQci": 9}],
            "score": 4.9,
            "judge": "automatic",
            "validFor": 10.0,
        }
        assert not problems(told["turtle1"], APPLICATION)

    def test_a_person_wins_and_the_worst_topic_counts(self) -> None:
        exposed = self.exposed()
        exposed.scored("mine", ("turtle1/pose",), 2.0, Judge.HUMAN, 0.0)
        told = exposed.reports(1.0, 10.0)
        assert list(told) == ["turtle1"]
        assert (told["turtle1"]["score"], told["turtle1"]["judge"]) == (2.0, "human")

    def test_who_is_not_judged_any_more_is_not_told(self) -> None:
        assert not self.exposed().reports(100.0, 10.0)


class TestWish:
    def test_the_network_may_slow_down_within_limits_and_not_speed_up(self) -> None:
        body = {"speedFactor": 0, "rateFactor": 7, "validFor": 0, "reason": "r"}
        assert wish_of(body, 0.25, 60.0) == Wish(0.25, 1.0, 60.0, "r")
        within = Wish(0.5, 0.75, 5.0, "r")
        assert wish_of(within.body(), 0.25, 60.0) == within

    @pytest.mark.parametrize(
        "body",
        [
            None,
            [],
            {},
            {"speedFactor": "1", "rateFactor": 1, "validFor": 1},
            {"speedFactor": -1, "rateFactor": 1, "validFor": 1},
            {"speedFactor": 1, "rateFactor": True, "validFor": 1},
            {"speedFactor": math.nan, "rateFactor": 1, "validFor": 1},
        ],
    )
    def test_what_is_none(self, body: Any) -> None:
        with pytest.raises(ApiMalformed, match="adaptation"):
            wish_of(body, 0.25, 60.0)


class Server:
    """The Network Layer Service Server of the mock, with a clock of ours."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.api = VasealApi(Desk(MockNetwork(), lambda: "http://mock", lambda: self.now_s))

    def call(self, method: str, name: str = "", body: Any = None) -> tuple[int, Any]:
        text = b"" if body is None else json.dumps(body).encode()
        path = f"/vaseal/v1/applications/{name}".rstrip("/")
        reply = self.api.answer(Request(method, path, {}, {}, text))
        return reply.status, reply.data


BODY = {
    "group": "my turtle",
    "topics": ["t/pose"],
    "speedFactor": 1,
    "rateFactor": 1,
    "validFor": 10,
    "notificationDestination": "http://robot/x",
}


class TestNetworkServer:
    def test_an_application_is_told_seen_and_taken_back(self) -> None:
        server = Server()
        assert server.call("GET", "my%20turtle")[0] == 404
        assert server.call("PUT", "my%20turtle", BODY) == (201, BODY)
        assert server.call("PUT", "my%20turtle", BODY) == (200, BODY)
        assert server.call("GET") == (200, [BODY])
        assert server.call("GET", "my%20turtle") == (200, BODY)
        assert server.call("POST", "my%20turtle", BODY)[0] == 405
        assert server.call("DELETE", "my%20turtle")[0] == 204
        assert server.call("GET") == (200, [])

    def test_it_expires_when_nobody_says_it_again(self) -> None:
        server = Server()
        server.call("PUT", "my%20turtle", BODY)
        server.now_s = 9.9
        assert server.api.applications
        server.now_s = 10.0
        assert not server.api.applications

    def test_what_it_does_not_take(self) -> None:
        server = Server()
        assert server.call("PUT", "other", BODY)[0] == 400
        with pytest.raises(BadBody, match="topics"):
            server.call("PUT", "my%20turtle", BODY | {"topics": []})

    def test_somebody_there_asks_for_less(self) -> None:
        server = Server()
        server.call("PUT", "my%20turtle", BODY)
        wish = Wish(0.5, 0.5, 5.0).body()

        def asked(name: str) -> tuple[int, str]:
            request = Request("POST", f"/mock/adapt/{name}", {}, {}, json.dumps(wish).encode())
            reply, outgoing = server.api.wish(request)
            return reply.status, "" if outgoing is None else outgoing.url

        assert asked("my%20turtle") == (202, "http://robot/x")
        assert asked("nobody") == (404, "")


class TestLoadedCell:
    def network(self) -> MockNetwork:
        network = MockNetwork(MockSettings(setup_s=0.0))
        bearer = network.ask("a", "flow", 83, (82, 85), 1000.0, 60.0, 0.0)
        assert isinstance(bearer, Bearer)
        network.tick(0.0)
        return network

    def test_classes_that_are_too_quick_are_not_given(self) -> None:
        network = self.network()
        network.settings = MockSettings(setup_s=0.0, least_delay_ms=11.0)
        (event,) = network.tick(1.0)
        assert event.bearer.state is BearerState.DEGRADED
        assert event.bearer.applied.qci == 9
        assert network.change("a", 82, (), 1000.0, 60.0, 2.0) is Admission.TOO_LOADED
        assert network.ask("b", "f", 80, (), 0.0, 60.0, 2.0) is Admission.TOO_LOADED
        lower = network.change("a", 84, (85,), 1000.0, 60.0, 3.0)
        assert isinstance(lower, Bearer)
        (event,) = network.tick(3.0)
        assert (event.bearer.state, event.bearer.applied.qci) == (BearerState.ACTIVE, 84)

    def test_when_it_has_recovered_they_are_given_again(self) -> None:
        network = self.network()
        network.settings = MockSettings(least_delay_ms=11.0)
        network.tick(1.0)
        network.settings = MockSettings()
        (event,) = network.tick(2.0)
        assert (event.bearer.state, event.bearer.applied.qci) == (BearerState.ACTIVE, 83)

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros_engines.network_exposure.exposure import schemas
from simple_ros_engines.network_exposure.exposure.camara import DEFAULT_PROFILES
from simple_ros_engines.network_exposure.exposure.camara_bodies import (
    camara_event,
    camara_profile,
    camara_session,
)
from simple_ros_engines.network_exposure.exposure.model import (
    Event,
    FiveTuple,
    QosRequest,
    UeIdentity,
)
from simple_ros_engines.network_exposure.exposure.nef_bodies import as_session, nef_events
from simple_ros_engines.network_exposure.exposure.notation import (
    bit_rate,
    bits_per_second,
    error_rate,
    flow_descriptions,
    uri_stamp,
)
from simple_ros_engines.network_exposure.exposure.retrying import RetryPolicy, retry_after_s
from simple_ros_engines.network_exposure.exposure.schema import problems
from simple_ros_engines.network_exposure.exposure.seal_bodies import (
    monitoring_event,
    monitoring_subscription,
    unicast_subscription,
    val_group,
)
from simple_ros_engines.network_exposure.mock.core import (
    Admission,
    Bearer,
    BearerState,
    MockNetwork,
    MockSettings,
)
from simple_ros_engines.network_exposure.qci import QCI

NOW = datetime(2026, 3, 1, 12, 0, 0, tzinfo=UTC)
FLOW = FiveTuple("UDP", "10.45.0.2", 4000, "10.45.0.9", 5000)
UE = UeIdentity("extid-robot@example.com", "10.45.0.2")
REQUEST = QosRequest("pose", FLOW, UE, QCI[3], (QCI[84],), 1_500_000.5, 1200, 60)


class TestSchema:
    @pytest.mark.parametrize(
        ("value", "schema", "wrong"),
        [
            (1, {"type": "string"}, "int instead of string"),
            (True, {"type": "integer"}, "bool instead of integer"),
            ({}, {"required": ("a",)}, "a is missing"),
            ({"b": 1}, {"properties": {}, "additionalProperties": False}, "b is not known"),
            ({"a": [1, "x"]}, {"properties": {"a": {"items": {"type": "integer"}}}}, r"\$\.a\[1\]"),
            ([], {"minItems": 1}, "0 items"),
            ("x", {"pattern": "^y"}, "does not match"),
            ("", {"minLength": 1}, "shorter"),
            (9, {"maximum": 8}, "out of range"),
            ("q", {"enum": ("a", "b")}, "none of a, b"),
            ({}, {"minProperties": 1}, "fewer"),
            ({"a": 1, "b": 2}, {"oneOf": ({"required": ("a",)}, {"required": ("b",)})}, "fits 2"),
            ({}, {"anyOf": ({"required": ("a",)},)}, "fits 0"),
        ],
    )
    def test_finds(self, value: Any, schema: dict[str, Any], wrong: str) -> None:
        (found,) = problems(value, schema)
        import re

        assert re.search(wrong, found)

    @given(
        st.recursive(
            st.none() | st.booleans() | st.integers() | st.text(),
            lambda s: st.lists(s) | st.dictionaries(st.text(), s),
        )
    )
    def test_takes_anything(self, value: Any) -> None:
        for schema in (
            schemas.AS_SESSION,
            schemas.SESSION_INFO,
            schemas.GROUP,
            schemas.MONITORING_REPORT,
        ):
            assert problems(value, schema)


class TestUnits:
    @pytest.mark.parametrize(
        ("rate", "text"),
        [
            (0, "1 bps"),
            (999, "999 bps"),
            (1000, "1 Kbps"),
            (1_500_000.5, "1.501 Mbps"),
            (2e9, "2 Gbps"),
        ],
    )
    def test_bit_rates(self, rate: float, text: str) -> None:
        assert bit_rate(rate) == text
        assert bits_per_second(text) >= rate

    @given(st.floats(1, 1e12))
    def test_bit_rates_are_never_too_small(self, rate: float) -> None:
        text = bit_rate(rate)
        assert not problems(text, schemas.BIT_RATE)
        assert rate <= bits_per_second(text) <= rate * 1.001 + 1

    def test_no_bit_rate(self) -> None:
        with pytest.raises(ValueError, match="no bit rate"):
            bits_per_second("5 potatoes")

    @pytest.mark.parametrize(
        ("rate", "text"),
        [(1e-2, "1E-2"), (1e-6, "1E-6"), (0.05, "5E-2"), (1, "1E-0"), (1e-12, "1E-9")],
    )
    def test_error_rates(self, rate: float, text: str) -> None:
        assert error_rate(rate) == text

    def test_stamps(self) -> None:
        assert uri_stamp(NOW) == "2026-03-01T12:00:00Z"


class TestBodies:
    def test_what_is_sent_is_valid(self) -> None:
        url = "https://robot.example.com/n/1"
        for request in (
            REQUEST,
            QosRequest("pose", FLOW, UeIdentity(ip="10.45.0.9", is_uplink=False), QCI[9]),
        ):
            assert not problems(
                unicast_subscription(request, url, NOW), schemas.UNICAST_SUBSCRIPTION
            )
            assert not problems(
                monitoring_subscription(request, url, 1), schemas.MONITORING_SUBSCRIPTION
            )
            assert not problems(as_session(request, url, "5qi_{qci}"), schemas.AS_SESSION)
            body = camara_session(request, "QOS_S", url, "secret", NOW)
            assert not problems(body, schemas.CREATE_SESSION)
        assert not problems(val_group("cell", [{"valUeId": "a@b.c"}], "s"), schemas.GROUP)

    def test_seal_has_its_quality_in_a_string(self) -> None:
        qos = json.loads(unicast_subscription(REQUEST, "http://x/", NOW)["uniQosReq"])
        assert not problems(qos, schemas.UNIQUE_QOS)
        assert (qos["5qi"], qos["gbrUl"], qos["per"]) == (3, "1.501 Mbps", "1E-3")
        old = json.loads(
            unicast_subscription(REQUEST, "http://x/", NOW, compat="ericsson")["uniQosReq"]
        )
        assert old["flowID"] == {
            "srcIp": "10.45.0.2", "srcPort": 4000, "dstIp": "10.45.0.9", "dstPort": 5000, "protocol": "UDP"
        }  # fmt: skip
        assert (old["qci"], old["ulBW"], old["dlBW"]) == (3, 1_500_001, 0)

    def test_filters_say_which_way(self) -> None:
        assert flow_descriptions(FLOW, UE) == ["permit in 17 from 10.45.0.2 4000 to 10.45.0.9 5000"]
        down = UeIdentity(ip="10.45.0.9", is_uplink=False)
        assert flow_descriptions(FLOW, down)[0].startswith("permit out 17")

    def test_nef_names_classes(self) -> None:
        body = as_session(REQUEST, "http://x/", "5qi_{qci}")
        assert (body["qosReference"], body["altQoSReferences"]) == ("5qi_3", ["5qi_84"])
        assert body["tscQosReq"] == {"reqGbrUl": "1.501 Mbps"}
        data = {
            "transaction": "http://x/1",
            "eventReports": [
                {"event": "QOS_NOT_GUARANTEED", "appliedQosRef": "5qi_84"},
                {"event": "QOS_MONITORING", "qosMonReports": [{"ulDelays": [3, 8]}]},
                {"event": "SOMETHING_NEW"},
            ],
        }
        less, measured, new = nef_events(data, {"5qi_84": 84})
        assert (less.event, less.applied_qci) == (Event.DOWNGRADED, 84)
        assert measured.measurements == {"ul_delay_ms": 8.0}
        assert new.event is Event.MEASURED

    def test_camara_profiles(self) -> None:
        names = [camara_profile(QCI[n], DEFAULT_PROFILES) for n in (80, 3, 1, 9)]
        assert names == ["QOS_E", "QOS_S", "QOS_M", "QOS_L"]
        assert camara_profile(QCI[3], {"3": "mine", "*": "rest"}) == "mine"

    def test_camara_devices(self) -> None:
        def device(ue: UeIdentity) -> Any:
            return camara_session(QosRequest("t", FLOW, ue, QCI[3]), "QOS_S", "", "", NOW)["device"]

        assert device(UeIdentity("msisdn-491700000001")) == {"phoneNumber": "+491700000001"}
        down = device(UeIdentity(is_uplink=False))
        assert down == {"ipv4Address": {"publicAddress": "10.45.0.9", "publicPort": 5000}}

    def test_camara_events(self) -> None:
        data = {
            "data": {"sessionId": "1", "qosStatus": "UNAVAILABLE", "statusInfo": "DURATION_EXPIRED"}
        }
        told = camara_event(data)
        assert (told.event, told.detail) == (Event.TERMINATED, "DURATION_EXPIRED")

    def test_measurements(self) -> None:
        report = {"measData": {"ulDelay": 70, "avgPlr": 5, "avgDataRate": "1 Mbps"}}
        told = monitoring_event(report, "s", 50, True)
        assert told.event is Event.DOWNGRADED
        assert told.measurements == {"ul_delay_ms": 70, "loss": 0.005, "rate_bps": 1e6}
        assert monitoring_event(report, "s", 50, False).event is Event.MEASURED
        assert monitoring_event(report, "s", 80, True).event is Event.RECOVERED


class TestRetries:
    def test_when(self) -> None:
        policy = RetryPolicy(3, 0.2, 5)
        assert policy.delay_s(1, None, None) == 0.2
        assert policy.delay_s(2, 503, None) == 0.4
        assert policy.delay_s(1, 429, 3.0) == 3.0
        assert policy.delay_s(1, 429, 30.0) is None
        assert policy.delay_s(3, 503, None) is None
        assert policy.delay_s(1, 403, None) is None

    def test_retry_after(self) -> None:
        assert retry_after_s("7", NOW) == 7
        assert retry_after_s("Sun, 01 Mar 2026 12:00:09 GMT", NOW) == 9
        assert retry_after_s("Sun, 01 Mar 2026 11:00:00 GMT", NOW) == 0
        assert retry_after_s("99999999", NOW) == 3600
        assert retry_after_s("soon", NOW) is None
        assert retry_after_s(None, NOW + timedelta(1)) is None


class TestMockNetwork:
    def network(self, **settings: float) -> MockNetwork:
        return MockNetwork(MockSettings(**{"setup_s": 2.0, "capacity_bps": 10e6} | settings))  # type: ignore[arg-type]

    def ask(
        self, network: MockNetwork, name: str, qci: int, rate: float = 6e6, *others: int
    ) -> Bearer:
        made = network.ask(name, name, qci, others, rate, 100, 0)
        assert isinstance(made, Bearer)
        return made

    def test_bearers_take_time(self) -> None:
        network = self.network()
        bearer = self.ask(network, "a", 3)
        assert network.tick(1.9) == []
        assert network.next_s() == 2.0
        (event,) = network.tick(2.0)
        assert (event.before, bearer.state) == (BearerState.SETTING_UP, BearerState.ACTIVE)
        assert network.tick(3) == []

    def test_admission(self) -> None:
        network = self.network()
        self.ask(network, "a", 3)
        assert network.ask("b", "b", 3, (), 6e6, 100, 0) is Admission.NO_CAPACITY
        assert network.ask("b", "b", 11, (), 6e6, 100, 0) is Admission.UNKNOWN_CLASS
        assert network.ask("b", "a", 9, (), 0, 100, 0, may_share_flow=False) is Admission.CONFLICT
        assert self.ask(network, "c", 3, 6e6, 80).applied.qci == 80
        assert self.network(max_bearers=0).ask("a", "a", 9, (), 0, 1, 0) is Admission.TOO_MANY
        assert (network.admitted, network.refused) == (2, 3)

    def test_the_least_important_lose_first_and_come_back(self) -> None:
        network = self.network(capacity_bps=20e6, setup_s=0)
        high, low = self.ask(network, "high", 3), self.ask(network, "low", 4, 6e6, 80)
        network.tick(0)
        network.settings = MockSettings(0, 7e6)
        events = network.tick(1)
        assert [(event.bearer.id, event.bearer.applied.qci) for event in events] == [("low", 80)]
        assert network.delay_ms(low) == 900
        network.settings = MockSettings(0, 0)
        assert {event.bearer.id for event in network.tick(2)} == {"high"}
        assert (high.applied.qci, high.state) == (9, BearerState.DEGRADED)
        network.settings = MockSettings(0, 20e6)
        assert {event.bearer.state for event in network.tick(3)} == {BearerState.ACTIVE}
        assert network.delay_ms(high) == 25

    def test_changes_are_set_up_anew(self) -> None:
        network = self.network()
        bearer = self.ask(network, "a", 3)
        network.tick(2)
        network.change("a", 3, (), 6e6, 100, 3)
        assert bearer.state is BearerState.ACTIVE
        network.change("a", 83, (), 1e6, 100, 4)
        assert (bearer.state, bearer.ready_s) == (BearerState.SETTING_UP, 6)
        assert network.change("a", 3, (), 99e6, 100, 4) is Admission.NO_CAPACITY

    def test_sessions_expire(self) -> None:
        network = self.network(setup_s=0)
        self.ask(network, "a", 3)
        network.tick(0)
        network.extend("a", 50)
        assert network.tick(149) == []
        (event,) = network.tick(150)
        assert (event.reason, event.bearer.state) == ("expired", BearerState.ENDED)
        assert not network.bearers

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from support.certificates import made_in, server_tls
from support.openapi import FILES, Recorder, judge, needs_openapi, problems_of
from support.waiting import until

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.exposure import schemas
from simple_ros_engines.network_exposure.exposure.api import ApiClient, Credentials
from simple_ros_engines.network_exposure.exposure.base import ExposureBackend, SessionGone
from simple_ros_engines.network_exposure.exposure.camara import CamaraBackend
from simple_ros_engines.network_exposure.exposure.http import StandardTransport, client_tls
from simple_ros_engines.network_exposure.exposure.model import (
    ApiMalformed,
    ApiRefused,
    ApiUnavailable,
    Event,
    FiveTuple,
    Notification,
    QosRequest,
    UeIdentity,
)
from simple_ros_engines.network_exposure.exposure.nef import NefBackend
from simple_ros_engines.network_exposure.exposure.receiver import NotificationReceiver
from simple_ros_engines.network_exposure.exposure.retrying import RetryPolicy
from simple_ros_engines.network_exposure.exposure.schema import problems
from simple_ros_engines.network_exposure.exposure.seal import SealBackend
from simple_ros_engines.network_exposure.mock.core import MockSettings
from simple_ros_engines.network_exposure.mock.server import MockServer
from simple_ros_engines.network_exposure.qci import QCI

KINDS: dict[str, Any] = {"seal": SealBackend, "nef": NefBackend, "camara": CamaraBackend}
FLOW = FiveTuple("TCP", "10.45.0.2", 40000, "10.45.0.9", 50000)
REQUEST = QosRequest(
    "cmd_vel",
    FLOW,
    UeIdentity("extid-robot1@example.com", "10.45.0.2"),
    QCI[3],
    (QCI[84], QCI[80]),
    40_000.0,
    400,
    600,
)
QUICK = RetryPolicy(attempts=3, first_s=0.01, longest_s=0.1)


@dataclass
class Bench:
    """A back end, the mock network it asks, and all that was said."""

    mock: MockServer
    backend: ExposureBackend
    receiver: NotificationReceiver
    asked: Recorder
    sent: Recorder
    heard: list[Notification] = field(default_factory=list)

    def events(self) -> list[Event]:
        return [told.event for told in self.heard if told.event is not Event.MEASURED]


@pytest.fixture(scope="session")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A certificate for loopback, with its key in the same file."""
    return made_in(tmp_path_factory.mktemp("tls"))


@asynccontextmanager
async def bench(
    kind: str,
    certificate: Path | None = None,
    *,
    secret: str = "",
    timeout_s: float = 5.0,
    **settings: Any,
) -> AsyncIterator[Bench]:
    tls = server_tls(certificate) if certificate else None
    trust = client_tls(str(certificate)) if certificate else None
    asked, sent = Recorder(StandardTransport(trust)), Recorder(StandardTransport(trust))
    mock = MockServer(
        MockSettings(**{"setup_s": 0.05} | settings),
        client_id="robot" if secret else "",
        client_secret=secret,
        tls=tls,
        notifies=sent,
    )
    receiver = NotificationReceiver(tls=tls)
    heard: list[Notification] = []
    await receiver.start()
    try:
        async with mock:
            credentials = Credentials(mock.token_url, "robot", secret) if secret else None
            client = ApiClient(mock.url, asked, credentials, timeout_s=timeout_s, retries=QUICK)
            backend = KINDS[kind](client, receiver, heard.append)
            asked.is_spoiling = lambda: mock.faults.malformed
            yield Bench(mock, backend, receiver, asked, sent, heard)
    finally:
        await receiver.close()
    # Every request and every answer of every test here, by the official files where they are.
    assert await asyncio.to_thread(asked.complaints) == []


async def life(on: Bench) -> None:
    """Everything that can happen to a session."""
    backend = on.backend
    await backend.ensure_group("cell7")
    await backend.join("cell7", REQUEST.ue)
    first = await backend.request(REQUEST)
    await until(lambda: any(b.state.value == "active" for b in on.mock.network.bearers.values()))
    await backend.monitor(first.id)
    await backend.renew(first.id, REQUEST) if backend.name == "camara" else None
    other = await backend.update(first.id, replace(REQUEST, wanted=QCI[80], alternatives=()))
    assert len(on.mock.network.bearers) == 1
    await backend.monitor(other.id)
    assert backend.resources()
    await until(lambda: any(b.state.value == "active" for b in on.mock.network.bearers.values()))
    await backend.release(other.id)
    await backend.release(other.id)
    await backend.leave_groups()
    assert not on.mock.network.bearers
    assert not on.mock.seal.groups
    assert not on.mock.seal.monitors
    assert not backend.resources()


@pytest.mark.parametrize("kind", KINDS)
class TestEach:
    async def test_whole_life(self, kind: str, certificate: Path) -> None:
        async with bench(kind, certificate, secret="s3cret") as on:
            await life(on)
            assert on.backend.client.is_simulated
            assert on.mock.tokens.issued == 1

    @needs_openapi
    async def test_official_files_find_nothing(self, kind: str, certificate: Path) -> None:
        async with bench(kind, certificate) as on:
            await life(on)
            await until(lambda: not on.mock._sending)
            on.mock.faults.status, on.mock.faults.status_count = 403, 1
            with pytest.raises(ApiRefused):
                await on.backend.request(REQUEST)
            assert len(on.asked.exchanges) >= 5
            assert await asyncio.to_thread(on.asked.complaints) == []

    @needs_openapi
    async def test_official_files_find_mistakes(self, kind: str) -> None:
        async with bench(kind) as on:
            await on.backend.request(REQUEST)
            sent = on.asked.exchanges[-1]
            body = json.loads(sent.request.body)
            spoilt = {
                name: item
                for name, item in body.items()
                if "otif" not in name and name != "duration"
            }
            worse = replace(sent, request=replace(sent.request, body=json.dumps(spoilt).encode()))
            assert any("required" in text for text in judge(worse))

    async def test_token_is_renewed(self, kind: str, certificate: Path) -> None:
        async with bench(kind, certificate, secret="s3cret") as on:
            session = await on.backend.request(REQUEST)
            on.mock.tokens.revoke_all()
            await on.backend.release(session.id)
            assert on.mock.tokens.issued == 2

    async def test_wrong_secret(self, kind: str) -> None:
        async with bench(kind, secret="s3cret") as on:
            credentials = Credentials(on.mock.token_url, "robot", "wrong")
            on.backend.client = ApiClient(on.mock.url, on.asked, credentials, retries=QUICK)
            with pytest.raises(ApiRefused, match=r"401.*invalid_client"):
                await on.backend.request(REQUEST)
            assert "wrong" not in repr(credentials)

    @pytest.mark.parametrize(
        ("faults", "error"),
        [
            ({"is_down": True}, (ApiMalformed, ApiUnavailable)),
            ({"delay_s": 5.0}, ApiUnavailable),
            ({"status": 401}, ApiRefused),
            ({"status": 429, "retry_after_s": 60}, ApiUnavailable),
            ({"status": 500}, ApiUnavailable),
            ({"status": 503}, ApiUnavailable),
            ({"malformed": True}, ApiMalformed),
        ],
        ids=str,
    )
    async def test_faults(self, kind: str, faults: dict[str, Any], error: Any) -> None:
        # Only one that does not answer is to be given up early.
        async with bench(kind, timeout_s=0.7 if "delay_s" in faults else 5.0) as on:
            on.mock.control(faults)
            with pytest.raises(error) as found:
                await on.backend.request(REQUEST)
            if "retry_after_s" in faults:
                assert found.value.retry_after_s == 60
            assert not on.backend.resources()
            on.mock.control({name: type(value)(0) for name, value in faults.items()})
            await on.backend.request(REQUEST)
            assert len(on.backend.resources()) == 1

    async def test_a_fault_that_passes_is_not_seen(self, kind: str) -> None:
        async with bench(kind) as on:
            on.mock.control({"status": 503, "status_count": 2})
            await on.backend.request(REQUEST)
            assert [status for _, _, status in on.mock.requests][:3] == [503, 503, 201]

    async def test_nobody_there(self, kind: str) -> None:
        async with bench(kind) as on:
            await on.mock.close()
            with pytest.raises(ApiUnavailable, match="cannot be reached"):
                await on.backend.request(REQUEST)
            on.mock._server = type(on.mock._server)(on.mock._answer)
            await on.mock.start()

    async def test_no_capacity(self, kind: str) -> None:
        async with bench(kind, capacity_bps=1.0) as on:
            asked = replace(REQUEST, alternatives=())
            with pytest.raises((ApiRefused, ApiUnavailable), match="capacity"):
                await on.backend.request(asked)

    async def test_own_certificates_are_needed(self, kind: str, certificate: Path) -> None:
        async with bench(kind, certificate) as on:
            on.backend.client = ApiClient(on.mock.url, StandardTransport(), retries=QUICK)
            with pytest.raises(ApiUnavailable, match="certificate"):
                await on.backend.request(REQUEST)


class TestGroups:
    """SEAL: several programs in one group."""

    async def test_members_of_others_stay(self) -> None:
        other_ue = UeIdentity("extid-robot2@example.com", "10.45.0.3")
        async with bench("seal") as on:
            other = SealBackend(on.backend.client, on.receiver, on.heard.append)
            for backend, ue in ((on.backend, REQUEST.ue), (other, other_ue)):
                await backend.ensure_group("cell7")
                await backend.join("cell7", ue)
                await backend.join("cell7", ue)
            assert self.members(on) == ["robot1@example.com", "robot2@example.com"]
            await on.backend.leave_groups()
            assert self.members(on) == ["robot2@example.com"]
            await other.leave_groups()
            assert not on.mock.seal.groups

    async def test_a_group_that_is_gone_is_made_again(self) -> None:
        async with bench("seal") as on:
            await on.backend.ensure_group("cell7")
            await on.backend.join("cell7", REQUEST.ue)
            on.mock.seal.groups.clear()
            await on.backend.join("cell7", UeIdentity("extid-robot2@example.com"))
            assert self.members(on) == ["robot1@example.com", "robot2@example.com"]
            on.mock.seal.groups.clear()
            await on.backend.leave_groups()

    def members(self, on: Bench) -> list[str]:
        (group,) = on.mock.seal.groups.values()
        return [member["valUeId"] for member in group["members"]]


class TestUnanswered:
    """Requests whose answer is lost may have been carried out."""

    async def test_nef_releases_what_nobody_was_told_of(self) -> None:
        async with bench("nef", timeout_s=0.7) as on:
            on.mock.control({"delay_s": 1.5})
            with pytest.raises(ApiUnavailable):
                await on.backend.request(REQUEST)
            await until(lambda: len(on.mock.network.bearers) == 3)
            on.mock.control({"delay_s": 0.0, "malformed": True})
            with pytest.raises(ApiMalformed):
                await on.backend.request(REQUEST)
            assert len(on.mock.network.bearers) == 4
            on.mock.control({"malformed": False})
            session = await on.backend.request(REQUEST)
            assert [session.id.endswith(name) for name in on.mock.network.bearers] == [True]

    async def test_nef_looks_later_if_it_cannot_now(self) -> None:
        async with bench("nef") as on:
            on.mock.control({"malformed": True})
            with pytest.raises(ApiMalformed):
                await on.backend.request(REQUEST)
            on.mock.control({"malformed": False})
            with pytest.raises(ApiUnavailable):
                on.mock.control({"status": 503})
                await on.backend.tidy()
            on.mock.control({"status": 0})
            await on.backend.tidy()
            assert not on.mock.network.bearers

    async def test_seal_releases_what_an_answer_names(self) -> None:
        async with bench("seal") as on:
            on.mock.control({"malformed": True})
            with pytest.raises(ApiMalformed):
                await on.backend.request(REQUEST)
            assert not on.mock.network.bearers


class TestEvents:
    async def test_nef_downgrade_and_recovery(self) -> None:
        async with bench("nef") as on:
            session = await on.backend.request(REQUEST)
            assert session.is_pending
            await until(lambda: Event.GRANTED in on.events())
            assert on.heard[-1].applied_qci == 3
            on.mock.control({"capacity_bps": 0})
            await until(lambda: Event.DOWNGRADED in on.events())
            assert on.heard[-1].applied_qci == 80
            on.mock.control({"capacity_bps": 1e6})
            await until(lambda: Event.RECOVERED in on.events())
            (bearer,) = on.mock.network.bearers
            on.mock.terminate(bearer)
            await until(lambda: Event.TERMINATED in on.events())
            assert {told.session_id for told in on.heard} == {session.id}
            with pytest.raises(SessionGone):
                await on.backend.update(session.id, REQUEST)
            for exchange in on.sent.exchanges:
                data = json.loads(exchange.request.body)
                assert not problems(data, schemas.USER_PLANE_NOTIFICATION)

    async def test_camara_ends_what_is_not_given(self, certificate: Path) -> None:
        async with bench("camara", certificate) as on:
            session = await on.backend.request(REQUEST)
            await until(lambda: Event.GRANTED in on.events())
            on.mock.control({"capacity_bps": 0})
            await until(lambda: Event.TERMINATED in on.events())
            assert on.heard[-1].detail == "NETWORK_TERMINATED"
            with pytest.raises(SessionGone):
                await on.backend.renew(session.id, REQUEST)

    async def test_camara_clears_what_was_left_for_the_same_flow(self) -> None:
        async with bench("camara") as on:
            await on.backend.request(REQUEST)
            with pytest.raises(ApiRefused, match="409"):
                await on.backend.request(REQUEST)
            (left,) = on.mock.network.bearers
            on.backend._sessions.clear()
            session = await on.backend.request(REQUEST)
            assert session.id != left
            assert list(on.mock.network.bearers) == [session.id]

    async def test_camara_without_https_asks_for_no_events(self) -> None:
        async with bench("camara") as on:
            session = await on.backend.request(REQUEST)
            assert not session.is_pending
            assert b"sink" not in on.asked.exchanges[-1].request.body

    async def test_seal_sees_downgrades_by_the_delay(self) -> None:
        async with bench("seal") as on:
            session = await on.backend.request(REQUEST)
            await until(
                lambda: (
                    not on.mock.network.tick(0)
                    and on.mock.state()["bearers"][0]["state"] == "active"
                )
            )
            await on.backend.monitor(session.id)
            await until(lambda: Event.RECOVERED in on.events())
            on.mock.control({"capacity_bps": 0})
            await until(lambda: Event.DOWNGRADED in on.events())
            assert on.heard[-1].measurements["ul_delay_ms"] == 150

    async def test_sessions_expire(self) -> None:
        async with bench("nef") as on:
            await on.backend.request(replace(REQUEST, duration_s=1))
            await until(lambda: Event.TERMINATED in on.events())
            assert not on.mock.network.bearers

    async def test_lost_notifications(self) -> None:
        async with bench("nef") as on:
            on.mock.faults.loses_notifications = True
            await on.backend.request(REQUEST)
            await until(lambda: on.mock.unsent)
            assert not on.heard

    @needs_openapi
    async def test_official_files_like_the_notifications(self, certificate: Path) -> None:
        places = {
            "nef": ("/3gpp-as-session-with-qos/v1", "UserPlaneNotificationData"),
            "camara": ("/quality-on-demand/v1", "EventQosStatusChanged"),
            "seal": ("/ss-nrm/v1", "MonitoringReport"),
        }
        for kind, (root, name) in places.items():
            async with bench(kind, certificate) as on:
                session = await on.backend.request(REQUEST)
                await on.backend.monitor(session.id)
                await until(lambda: on.events())
                on.mock.control({"capacity_bps": 0})
                await until(lambda: {Event.DOWNGRADED, Event.TERMINATED} & set(on.events()))
                for exchange in on.sent.exchanges:
                    data = json.loads(exchange.request.body)
                    words = ("components", "schemas", name)
                    found = await asyncio.to_thread(problems_of, data, FILES[root], *words)
                    assert not found, (kind, found)
                    assert exchange.response.status == 204


class TestReceiver:
    async def post(self, url: str, data: Any, **headers: str) -> int:
        from simple_ros_engines.network_exposure.exposure.http import HttpRequest

        body = data if isinstance(data, bytes) else json.dumps(data).encode()
        request = HttpRequest("POST", url, headers, body)
        return (await StandardTransport().send(request, 5)).status

    async def test_takes_only_what_it_knows(self) -> None:
        receiver, taken = NotificationReceiver(), []
        await receiver.start()
        try:
            url, token = receiver.open(taken.append, with_token=True)
            assert await self.post(url, {}) == 401
            assert await self.post(url, {}, Authorization="Bearer no") == 401
            assert await self.post(url, {"a": 1}, Authorization=f"Bearer {token}") == 204
            assert await self.post(url, b"{", Authorization=f"Bearer {token}") == 400
            assert await self.post(receiver.url + "/notifications/guess", {}) == 404
            receiver.forget(url)
            assert await self.post(url, {}, Authorization=f"Bearer {token}") == 404
            assert taken == [{"a": 1}]
            assert (receiver.received, receiver.malformed, receiver.refused) == (1, 1, 4)
        finally:
            await receiver.close()

    def test_address_behind_a_proxy(self) -> None:
        receiver = NotificationReceiver("https://robots.example.com/in/")
        url, _ = receiver.open(lambda data: None)
        assert url.startswith("https://robots.example.com/in/notifications/")


def test_missing_certificates_are_named() -> None:
    with pytest.raises(ConfigError, match=r"no file /nowhere/ca\.pem"):
        client_tls("/nowhere/ca.pem")

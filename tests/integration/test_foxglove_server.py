from __future__ import annotations

import asyncio
import shutil
import socket
import ssl
import struct
import subprocess
from pathlib import Path

import pytest
from support.foxglove import BOTH, FoxClient, connected
from support.waiting import until
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Subprotocol

from simple_ros.foxglove import Access, FoxgloveServer, ServerOptions, TopicLimits
from simple_ros.foxglove.errors import CannotListen
from simple_ros.foxglove.frames import CAPABILITIES
from simple_ros.foxglove.server import tls_context
from simple_ros.foxglove.slowness import BUFFER_FULL

MB = 1_000_000


def server(**options: object) -> FoxgloveServer:
    made = FoxgloveServer(ServerOptions(**options), CAPABILITIES - {"time"})  # type: ignore[arg-type]
    for topic in ("/small", "/images"):
        made.add_channel(topic, "t", "")
    return made


@pytest.mark.parametrize(
    ("offered", "agreed"),
    [
        (("foxglove.websocket.v1",), "foxglove.websocket.v1"),
        (("foxglove.sdk.v1",), "foxglove.sdk.v1"),
        (BOTH, "foxglove.sdk.v1"),
    ],
)
async def test_subprotocols(offered: tuple[str, ...], agreed: str) -> None:
    async with server().listening(port=0) as running, connected(running.port, offered) as client:
        assert client.socket.subprotocol == agreed
        await until(lambda: client.topics == ["/small", "/images"])


async def test_who_is_not_let_in() -> None:
    options = {"access": Access.made(token="geheim")}
    async with server(**options).listening(port=0) as running:
        url = f"ws://127.0.0.1:{running.port}"
        good = [Subprotocol(BOTH[0])]
        for given, status, text in [
            ({"uri": f"{url}/?token=geheim"}, 400, "foxglove.sdk.v1 and foxglove.websocket.v1"),
            ({"uri": f"{url}/?token=geheim", "subprotocols": [Subprotocol("x")]}, 400, "foxglove"),
            ({"uri": url, "subprotocols": good}, 401, "token"),
            (
                {
                    "uri": f"{url}/?token=geheim",
                    "subprotocols": good,
                    "origin": "https://a.example",
                },
                403,
                "https://a.example",
            ),
        ]:
            with pytest.raises(InvalidStatus) as refused:
                async with connect(**given, proxy=None):  # type: ignore[arg-type]
                    pass
            assert refused.value.response.status_code == status
            assert text in bytes(refused.value.response.body or b"").decode()
        async with connect(f"{url}/?token=geheim", subprotocols=good, proxy=None) as opened:
            assert "serverInfo" in str(await opened.recv())


async def test_no_websocket_at_all() -> None:
    async with server().listening(port=0) as running:
        for request, answer in [(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", b"426"), (b"\0" * 99, b"")]:
            reader, writer = await asyncio.open_connection("127.0.0.1", running.port)
            writer.write(request)
            writer.write_eof()
            assert answer in await reader.read()
            writer.close()
        async with connected(running.port) as client:
            assert client.topics


def make_certificate(folder: Path) -> None:
    command = (
        "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2 "
        "-subj /CN=localhost -addext subjectAltName=IP:127.0.0.1 -keyout key.pem -out cert.pem"
    )
    subprocess.run(command.split(), cwd=folder, check=True, capture_output=True)


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl")
async def test_tls(tmp_path: Path) -> None:
    both = tmp_path / "both.pem"
    await asyncio.to_thread(make_certificate, tmp_path)
    both.write_text((tmp_path / "cert.pem").read_text() + (tmp_path / "key.pem").read_text())
    trust = ssl.create_default_context(cafile=str(tmp_path / "cert.pem"))
    context = tls_context(both)
    async with server().listening(port=0, tls=context) as running:
        url = f"wss://127.0.0.1:{running.port}"
        async with connect(
            url, ssl=trust, subprotocols=[Subprotocol(BOTH[0])], proxy=None
        ) as opened:
            assert "serverInfo" in str(await opened.recv())
    with pytest.raises(CannotListen):
        tls_context(tmp_path / "cert.pem")
    command = "openssl ec -in key.pem -aes128 -passout pass:geheim -out locked.pem"
    await asyncio.to_thread(
        subprocess.run, command.split(), cwd=tmp_path, check=True, capture_output=True
    )
    with pytest.raises(CannotListen, match=r"locked\.pem: it is encrypted"):
        tls_context(tmp_path / "cert.pem", tmp_path / "locked.pem")


async def test_a_port_in_use() -> None:
    async with server().listening(port=0) as running:
        with pytest.raises(CannotListen, match=str(running.port)):
            async with server().listening(port=running.port):
                pass


async def test_messages() -> None:
    async with (
        server().listening(port=0) as running,
        connected(running.port) as a,
        connected(running.port) as b,
    ):
        await a.subscribe("/images")
        await a.subscribe("/small")
        await b.subscribe("/small")
        await until(lambda: running.is_wanted(1) and running.is_wanted(2))
        await until(lambda: len(running._wanting.get(1, ())) == 2)
        large = bytes(range(256)) * 4000
        running.publish(1, 5, [b"x", b""])
        running.publish(2, 6, [large])
        await until(lambda: len(a.messages) == 3 and len(b.messages) == 2)
        assert b.messages == [(0, 5, b"x"), (0, 5, b"")]
        assert (0, 6, large) in a.messages
        assert [item for item in a.messages if item[0] == 1] == [(1, 5, b"x"), (1, 5, b"")]


@pytest.mark.parametrize("willing", [True, False])
async def test_compression(*, willing: bool) -> None:
    server = FoxgloveServer(ServerOptions(compress=True), ())
    channel = server.add_channel("/x", "t", "")
    payloads = [b"a" * 100_000, b"", b"b" * 200]
    async with server.listening(port=0):
        options = {"compression": "deflate" if willing else None}
        async with connected(server.port, **options) as client:
            assert bool(client.socket.protocol.extensions) is willing
            await client.subscribe("/x")
            await until(lambda: server.is_wanted(channel.id))
            server.publish(channel.id, 7, payloads)
            await until(lambda: client.on("/x") == payloads)
            assert {stamp for _, stamp, _ in client.messages} == {7}


async def test_a_large_message_of_a_client() -> None:
    got = []
    running = server()
    running.on_event = lambda _client, event: got.append(event)
    async with running.listening(port=0), connected(running.port) as client:
        await client.advertise(1, "/x", "t", "protobuf")
        await client.publish(1, bytes(5 * MB))
        await until(lambda: len(got) == 2)
        assert len(got[1].payload) == 5 * MB  # type: ignore[attr-defined]


async def test_garbage_changes_nothing() -> None:
    async with server().listening(port=0) as running, connected(running.port) as client:
        for frame in ("", "{", "[]", b"", b"\x00", b"\x01", b"\xff" * 10, '{"op": "subscribe"}'):
            await client.socket.send(frame)
        await until(lambda: len(client.statuses()) == 7)
        assert {level for level, _ in client.statuses()} == {2}
        await client.subscribe("/small")
        await until(lambda: running.is_wanted(1))


async def test_fragmented_messages() -> None:
    async with server().listening(port=0) as running, connected(running.port) as client:
        await client.socket.send(
            ['{"op": "subscribe", "subscri', 'ptions": [{"id": 0, ', '"channelId": 1}]}']
        )
        await until(lambda: running.is_wanted(1))


# -- slow clients ----------------------------------------------------------------------------------


async def flood(running: FoxgloveServer, rounds: int, image: bytes) -> None:
    for number in range(rounds):
        running.publish(2, number, [image])
        running.publish(1, number, [number.to_bytes(4, "big")])
        await asyncio.sleep(0)


async def stalled(client: FoxClient) -> None:
    """Subscribe to all, then read no more."""
    await client.subscribe("/images")
    await client.subscribe("/small")
    client.paused.clear()
    client.socket.transport.pause_reading()


async def test_a_stalled_client_keeps_its_budget_and_the_small_messages() -> None:
    budget = 8 * MB
    async with (
        server(buffer_bytes=budget).listening(port=0) as running,
        connected(running.port, max_queue=1) as slow,
        connected(running.port) as quick,
    ):
        await stalled(slow)
        await quick.subscribe("/small")
        await until(lambda: len(running._wanting.get(1, ())) == 2 and running.is_wanted(2))
        rounds, image = 600, bytes(500_000)
        for _ in range(6):
            await flood(running, rounds // 6, image)
            statistics = max(running.statistics, key=lambda item: item.waiting_bytes)
            assert statistics.waiting_bytes <= budget
        assert statistics.dropped_total > 400
        await until(lambda: len(quick.messages) == rounds, "others are not delayed")
        slow.paused.set()
        slow.socket.transport.resume_reading()
        await until(lambda: len(slow.on("/small")) == rounds, "no small message is lost")
        numbers = [int.from_bytes(data, "big") for data in slow.on("/small")]
        assert numbers == list(range(100)) * 6
        await until(lambda: len(slow.on("/images")) + running.dropped == rounds)
        assert 5 < len(slow.on("/images")) < rounds
        assert (1, BUFFER_FULL) in slow.statuses()
        assert slow.heard("status")[0]["id"] == "slow-client"


async def test_only_the_newest_waits() -> None:
    depths = TopicLimits.made(["/images=1"], "--queue")
    async with (
        server(depths=depths).listening(port=0) as running,
        connected(running.port, max_queue=1) as slow,
    ):
        await stalled(slow)
        await until(lambda: running.is_wanted(1) and running.is_wanted(2))
        await flood(running, 200, bytes(200_000))
        assert running.statistics[0].waiting_bytes < MB
        slow.paused.set()
        slow.socket.transport.resume_reading()
        await until(lambda: slow.messages and slow.messages[-1][1] >= 199)
        await until(lambda: (0, 199) in [(number, stamp) for number, stamp, _ in slow.messages])
        assert not slow.statuses(), "what is wanted so is no loss"


async def test_rates() -> None:
    rates = TopicLimits.made(["/sm*=1"], "--max-rate")
    async with server(rates=rates).listening(port=0) as running, connected(running.port) as client:
        await client.subscribe("/small")
        await client.subscribe("/images")
        await until(lambda: running.is_wanted(1) and running.is_wanted(2))
        running.publish(1, 0, [b"x"] * 50)
        running.publish(2, 0, [b"x"] * 50)
        await until(lambda: len(client.on("/images")) == 50)
        assert len(client.on("/small")) == 1


async def test_clients_that_break_off() -> None:
    complaints: list[object] = []
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda _, context: complaints.append(context))
    async with server().listening(port=0) as running:
        for rounds in range(1, 30):
            async with connected(running.port, max_queue=1) as client:
                await client.subscribe("/images")
                await until(lambda: running.is_wanted(2))
                await flood(running, rounds, bytes(100_000))
                linger = struct.pack("ii", 1, 0)
                found = client.socket.transport.get_extra_info("socket")
                found.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
                client.socket.transport.abort()
                await flood(running, 100, bytes(1000))
            await until(lambda: not running.clients)
    assert complaints == []


async def test_who_answers_no_ping_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    # Who answers has as long for it; here that is the same process, which may stand still meanwhile.
    monkeypatch.setattr("simple_ros.foxglove.connection._PING_S", 0.7)
    monkeypatch.setattr("simple_ros.foxglove.connection._CLOSE_S", 0.1)
    async with server().listening(port=0) as running, connected(running.port) as silent:
        async with connected(running.port) as idle:
            silent.socket.transport.pause_reading()
            await until(lambda: len(running.clients) == 1, "the silent one is cut off")
            pong = await idle.socket.ping()
            await asyncio.wait_for(pong, 30)
            assert idle.closed is None, "who answers stays, although it says nothing"
        silent.socket.transport.abort()


async def test_too_many_answers_end_the_connection() -> None:
    async with (
        server().listening(port=0) as running,
        connected(running.port, max_queue=1) as slow,
    ):
        slow.paused.clear()
        slow.socket.transport.pause_reading()
        frame = '{"op":"status","level":0,"message":"' + "x" * MB + '"}'
        for _ in range(40):
            running.say_if(lambda _: True, frame)
            await asyncio.sleep(0)
        slow.paused.set()
        slow.socket.transport.resume_reading()
        await until(lambda: not running.clients)
        await until(lambda: slow.closed)
        assert slow.closed is not None
        assert slow.closed.rcvd is not None
        assert slow.closed.rcvd.code == 1013


async def test_more_topics_than_answers_may_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("simple_ros.foxglove.client._CONTROL_BYTES", 100_000)
    running = server()
    for number in range(300):
        running.add_channel(f"/t{number}", "a.B", "x" * 1000)
    async with running.listening(port=0), connected(running.port) as client:
        await until(lambda: len(client.channels) == len(running.catalog.channels))
        running.reset_session()
        await until(lambda: len(client.heard("serverInfo")) == 2)
        assert client.closed is None


async def test_the_end() -> None:
    async with server().listening(port=0) as running:
        async with connected(running.port) as client:
            await client.subscribe("/small")
            await until(lambda: running.is_wanted(1))
        await until(lambda: not running.is_wanted(1))
        assert not running.clients
    async with server().listening(port=0) as running:
        waiting = connect(
            f"ws://127.0.0.1:{running.port}", subprotocols=[Subprotocol(BOTH[0])], proxy=None
        )
        opened = await waiting.__aenter__()
    with pytest.raises(ConnectionClosed) as closed:
        while True:
            await opened.recv()
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1001

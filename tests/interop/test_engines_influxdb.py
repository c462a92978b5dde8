"""InfluxDB's own programs: its server asked by our source, its client asking our store."""

from __future__ import annotations

import asyncio
import contextlib
import re
import shutil
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from influxdb_client import InfluxDBClient, Point
from influxdb_client.client.write_api import SYNCHRONOUS
from influxdb_client.rest import ApiException
from support.engines import at_work, source
from support.waiting import LIMIT_S, until

from simple_ros_engines.radio_information.node import RadioInformationEngine
from simple_ros_engines.store.database import MetricsStore
from simple_ros_engines.store.server import StoreServer
from simple_ros_master import Master

CONFIG = """
reporting-disabled = true
bind-address = "127.0.0.1:0"
[meta]
  dir = "{folder}/meta"
[data]
  dir = "{folder}/data"
  wal-dir = "{folder}/wal"
[monitor]
  store-enabled = false
[http]
  bind-address = "127.0.0.1:{port}"
  log-enabled = false
  auth-enabled = {auth}
"""


@asynccontextmanager
async def influxd(folder: Path, port: int = 0, auth: bool = False) -> AsyncIterator[int]:
    """A real server; gives its port."""
    program = shutil.which("influxd")
    if program is None:
        pytest.skip("there is no influxd here: apt-get install influxdb")
    file = folder / "influxdb.conf"
    file.write_text(CONFIG.format(folder=folder, port=port, auth=str(auth).lower()))
    process = await asyncio.create_subprocess_exec(
        program,
        "-config",
        str(file),
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
    )
    assert process.stderr is not None
    found = None
    try:
        async with asyncio.timeout(30):
            while found is None:
                line = (await process.stderr.readline()).decode()
                assert line, "influxd ended"
                found = re.search(r"Listening on HTTP.*addr=127\.0\.0\.1:(\d+)", line)
        # Nobody reads on: what it says more must not block it.
        rest = asyncio.create_task(process.stderr.read())
        yield int(found[1])
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()
    await rest


async def post(url: str, body: str) -> None:
    request = urllib.request.Request(url, body.encode(), method="POST")

    def send() -> None:
        with urllib.request.urlopen(request, timeout=30) as answer:
            assert answer.status < 300
            # A query that failed is answered with 200 all the same.
            said = answer.read().decode()
            assert '"error"' not in said, said

    await asyncio.to_thread(send)


async def create_database(url: str, access: str = "") -> None:
    """Create ``radio``; return once a server that has only just begun takes points for it."""
    end = time.monotonic() + LIMIT_S
    while True:
        await post(f"{url}/query?{access}&{question('CREATE DATABASE radio')}", "")
        try:
            await post(f"{url}/write?{access}&db=radio", "nothing nothing=1 1")
            return
        except urllib.error.HTTPError as error:
            if error.code != 404 or time.monotonic() > end:
                raise
        await asyncio.sleep(0.05)


def question(text: str) -> str:
    return urllib.parse.urlencode({"q": text})


async def test_a_server_of_influxdb_1_is_asked(master: Master, tmp_path: Path) -> None:
    engine = RadioInformationEngine()
    async with contextlib.AsyncExitStack() as stack:
        async with influxd(tmp_path) as port:
            url = f"http://127.0.0.1:{port}"
            options = source(
                "influx1", url=url, database="radio", measurement='odd "name"', period_s=0.05
            )
            await stack.enter_async_context(at_work(engine, master, **options))
            await until(lambda: engine.state == "degraded", "no such database")
            assert "database not found" in engine.detail
            await create_database(url)
            now = time.time_ns()
            lines = (
                f'odd\\ "name",rnti=4601,pci=1 snr_pusch=180.0,ul_bler=0.5 {now - 10**9}\n'
                f'odd\\ "name",rnti=4601,pci=1 snr_pusch=215.0,ul_bler=0.05,note="x" {now}\n'
                f'odd\\ "name",rnti=4602,pci=1 snr_pusch=-30.0,DL_Thr=12.5 {now}\n'
                f'odd\\ "name",rnti=4603 snr_pusch=10.0 {now - 30 * 10**9}\n'
                f'odd\\ "name",rnti=none snr_pusch=10.0 {now}\n'
            )
            await post(f"{url}/write?db=radio&precision=ns", lines)
            await until(lambda: {"4601", "4602"} <= set(engine.newest), "both devices")
            assert engine.newest["4601"][0].snr_db == pytest.approx(21.5)
            assert engine.newest["4601"][0].bler == pytest.approx(0.05)
            assert engine.newest["4602"][0].snr_db == pytest.approx(-3.0)
            assert engine.newest["4602"][0].throughput_bps == pytest.approx(12.5e6)
            assert "4603" not in engine.newest
            assert engine.source is not None
            assert engine.source.malformed == 1
            assert await engine.source.discover() == {"4601", "4602", "4603"}
            later = f'odd\\ "name",rnti=4601,pci=1 snr_pusch=100.0 {time.time_ns()}'
            await post(f"{url}/write?db=radio&precision=ns", later)
            await until(lambda: engine.newest["4601"][0].snr_db == 10.0, "the next point")
        # It is degraded before that, when no new point has come for a while.
        await until(lambda: "does not answer" in engine.detail, "the killed server")
        assert engine.state == "degraded"
        async with influxd(tmp_path, port):
            later = f'odd\\ "name",rnti=4601,pci=1 snr_pusch=120.0 {time.time_ns()}'
            await post(f"{url}/write?db=radio&precision=ns", later)
            await until(lambda: engine.newest["4601"][0].snr_db == 12.0, "the server again")
            await until(lambda: engine.state == "active", "all well")


async def test_a_server_of_influxdb_1_wants_a_password(master: Master, tmp_path: Path) -> None:
    engine, stranger = RadioInformationEngine(), RadioInformationEngine()
    async with influxd(tmp_path, auth=True) as port:
        url = f"http://127.0.0.1:{port}"
        create = "CREATE USER robot WITH PASSWORD 'it''s \"it\"' WITH ALL PRIVILEGES"
        # Quotes are escaped by a backslash in this language.
        create = create.replace("''", "\\'")
        await post(f"{url}/query?{question(create)}", "")
        access = urllib.parse.urlencode({"u": "robot", "p": 'it\'s "it"'})
        await create_database(url, access)
        line = f"glasses_18,rnti=4601 snr_pusch=215.0 {time.time_ns()}"
        await post(f"{url}/write?{access}&db=radio&precision=ns", line)
        common = {"url": url, "database": "radio", "period_s": 0.05, "window_s": 60}
        options = source("influx1", user="robot", password='it\'s "it"', **common)
        async with at_work(engine, master, **options):
            await until(lambda: "4601" in engine.newest, "the device")
        async with at_work(stranger, master, **source("influx1", **common)):
            await until(lambda: stranger.state == "degraded", "the refusal")
            assert "401" in stranger.detail


@asynccontextmanager
async def embedded() -> AsyncIterator[int]:
    store = MetricsStore()
    server = StoreServer(store)
    await server.start(port=0, udp_port=None)
    try:
        yield server.port
    finally:
        await server.close()
        store.close()


@pytest.mark.parametrize("is_packed", [False, True])
async def test_the_official_client_writes_and_asks_our_store(is_packed: bool) -> None:
    """Both queries of WirelessROS, as its users have them."""

    def work(port: int) -> None:
        with InfluxDBClient(
            f"http://127.0.0.1:{port}", "token", org="my_org", enable_gzip=is_packed, timeout=5000
        ) as client:
            assert client.ping()
            write = client.write_api(write_options=SYNCHRONOUS)
            point = Point("glasses_18").tag("rnti", "4601").tag("cell", "a b")
            point = point.field("snr_pusch", 215.0).field("cqi", 12).field("in_sync", True)
            write.write("my_bucket", "my_org", point.field("note", 'a "b", c=d'))
            write.write(
                "my_bucket", "my_org", Point("glasses_18").tag("rnti", "4602").field("x", 1)
            )
            ask = client.query_api().query
            tables = ask(
                'from(bucket: "my_bucket") |> range(start: -1m)'
                ' |> filter(fn: (r) => r["_measurement"] == "glasses_18")'
                ' |> group(columns: ["rnti"]) |> distinct(column: "rnti")'
            )
            found = [record.values["rnti"] for table in tables for record in table.records]
            assert found == [table.records[0].get_value() for table in tables] == ["4601", "4602"]
            start = (datetime.now(UTC) - timedelta(seconds=30)).isoformat().replace("+00:00", "Z")
            tables = ask(
                f'from(bucket: "my_bucket") |> range(start: {start})'
                ' |> filter(fn: (r) => r["_measurement"] == "glasses_18" and r["rnti"] == "4601")'
                " |> last()"
            )
            values = {r.get_field(): r.get_value() for table in tables for r in table.records}
            assert values == {"snr_pusch": 215.0, "cqi": 12, "in_sync": True, "note": 'a "b", c=d'}
            (first, *_) = tables[0].records
            assert first.get_measurement() == "glasses_18"
            assert first.values["cell"] == "a b"
            assert abs(first.get_time() - datetime.now(UTC)) < timedelta(minutes=1)
            with pytest.raises(ApiException, match="not understood"):
                ask('from(bucket: "my_bucket") |> range(start: -1m) |> mean()')
            with pytest.raises(ApiException) as refused:
                write.write("my_bucket", "my_org", "garbage")
            assert refused.value.status == 400

    async with embedded() as port:
        await asyncio.to_thread(work, port)


async def exchange(port: int, *parts: bytes, until_text: bytes) -> bytes:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        for part in parts:
            writer.write(part)
            await writer.drain()
        async with asyncio.timeout(30):
            return await reader.readuntil(until_text)
    finally:
        writer.close()
        await writer.wait_closed()


async def test_what_other_writers_of_influxdb_do() -> None:
    """Telegraf sends chunks and creates its database first; libcurl asks before it sends."""
    line = b"ue,rnti=4601 a=1"
    head = b"POST /api/v2/write HTTP/1.1\r\nHost: x\r\n"
    async with embedded() as port:
        chunks = b"6\r\nue,rnt\r\na;x=y\r\ni=4601 a=1\r\n0\r\nTrailer: 1\r\n\r\n"
        done = await exchange(
            port, head + b"Transfer-Encoding: chunked\r\n\r\n", chunks, until_text=b"\r\n\r\n"
        )
        assert done.startswith(b"HTTP/1.1 204")
        lengths = b"Expect: 100-continue\r\nContent-Length: %d\r\n\r\n" % len(line)
        asked = await exchange(port, head + lengths, until_text=b"\r\n\r\n")
        assert asked == b"HTTP/1.1 100 Continue\r\n\r\n"
        for bad in (b"zz\r\n", b"-1\r\n", b"fffffffff\r\n", b"1\r\nab\r\n"):
            refused = await exchange(
                port, head + b"Transfer-Encoding: chunked\r\n\r\n" + bad, until_text=b"\r\n\r\n"
            )
            assert refused.startswith(b"HTTP/1.1 413")
        await post(f"http://127.0.0.1:{port}/query", question("CREATE DATABASE telegraf"))
        far = b"ue,rnti=4601 a=1 99999999999999999999999"
        refused = await exchange(
            port, head + b"Content-Length: %d\r\n\r\n" % len(far), far, until_text=b"\r\n\r\n"
        )
        assert refused.startswith(b"HTTP/1.1 400")

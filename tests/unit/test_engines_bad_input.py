"""What the engines make of input that is wrong, too much or none at all."""

from __future__ import annotations

import asyncio
import gzip
import math
import socket

import numpy as np
import pytest

from simple_ros.errors import ConfigError
from simple_ros.msg.arrays import numpy_to_occupancy_grid
from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.nav_msgs import Path
from simple_ros.msg.wireless_ros_msgs import PhyLayerMetrics
from simple_ros_engines.cross_domain.core import CrossDomain, LinkMetrics
from simple_ros_engines.cross_domain.path import plan
from simple_ros_engines.cross_domain.quality_map import GridFrame, QualityMap
from simple_ros_engines.cross_domain.ways import better_way, frame_of
from simple_ros_engines.mapping_parameter import object_of
from simple_ros_engines.modes import Intake, Mode
from simple_ros_engines.own_link import OwnLink, is_meant
from simple_ros_engines.store.database import MetricsStore
from simple_ros_engines.store.flux import BadFlux, FluxQuery, parse_flux
from simple_ros_engines.store.line_protocol import parse_line
from simple_ros_engines.store.server import StoreServer
from simple_ros_engines.topics import Inlet, no_numbers

NOW = 1_700_000_000_000_000_000


class TestOwnLink:
    def test_the_only_one_there_is(self):
        own = OwnLink()
        assert own.link(0.0) == ""
        assert own.silent_s(0.0) is None
        own.heard("4601", 1.0)
        assert own.link(1000.0) == "4601"
        assert own.silent_s(3.0) == 2.0

    def test_one_of_several_is_not_known(self):
        own = OwnLink()
        own.heard("4601", 1.0)
        own.heard("4602", 1.0)
        assert own.link(2.0) == ""

    def test_a_device_that_attached_anew_has_another_name(self):
        own = OwnLink(lately_s=15.0)
        own.heard("4601", 1.0)
        own.heard("4602", 10.0)
        assert own.link(16.0) == ""
        own.heard("4602", 17.0)
        assert own.link(17.0) == "4602"

    def test_a_named_one_stays(self):
        own = OwnLink("wlan0")
        own.heard("4601", 1.0)
        assert own.link(1.0) == "wlan0"
        assert own.silent_s(1.0) is None

    def test_a_named_interface_means_the_station_it_speaks_with(self):
        own = OwnLink("wlan0")
        own.heard("wlan0/02:00:00:00:00:01", 1.0)
        own.heard("wlan1/02:00:00:00:00:09", 1.0)
        assert own.link(1.0) == "wlan0/02:00:00:00:00:01"
        own.heard("wlan0/02:00:00:00:00:02", 2.0)
        assert own.link(2.0) == "wlan0/02:00:00:00:00:02"

    def test_which_links_a_name_means(self):
        assert is_meant("", "4601")
        assert is_meant("4601", "4601")
        assert is_meant("wlan0", "wlan0/02:00:00:00:00:01")
        assert not is_meant("wlan0", "wlan01/02:00:00:00:00:01")

    def test_memory_is_bounded(self):
        own = OwnLink()
        for number in range(2000):
            own.heard(f"{number}", 0.001 * number)
        assert len(own._heard_s) == 1000


@pytest.mark.parametrize("mode", list(Mode))
def test_what_waits_is_not_lost_with_the_mode(mode: Mode):
    intake: Intake[int] = Intake(mode, budget=1)
    looked = [item for key in range(5) for item in intake.offer(key, key)]
    assert sorted(looked + intake.drain()) == [0, 1, 2, 3, 4]
    assert intake.tick() == intake.drain() == []


def test_what_is_no_number_is_found():
    message = PhyLayerMetrics(link_id="a", snr_db=math.nan, bler=math.inf, link_quality=0.5)
    assert sorted(no_numbers(message)) == ["bler", "snr_db"]


def test_messages_of_those_who_do_not_number_are_no_duplicates():
    came: list[PhyLayerMetrics] = []
    inlet = Inlet("/metrics", came.append)
    for _ in range(5):
        inlet.came(PhyLayerMetrics(link_id="a"))
    flow = inlet.flow()
    assert (len(came), flow.received, flow.duplicates, flow.gaps) == (5, 5, 0, 0)


@pytest.mark.parametrize("quality", [-5.0, 0.0, 7.0])
@pytest.mark.parametrize("bandwidth_bps", [-1.0, 0.0, 1e30])
def test_metrics_that_cannot_be_are_answered_with_what_is_safe(
    quality: float, bandwidth_bps: float
):
    decision = CrossDomain().decide(LinkMetrics("a", quality, 0.5, 20.0, bandwidth_bps))
    assert 0 <= decision.compression <= 0.9


@pytest.mark.parametrize("text", ["{", "[]", "1", "[" * 100_000])
def test_what_is_no_object(text: str):
    with pytest.raises(ConfigError, match="no JSON"):
        object_of(text)


def path_of(*points: tuple[float, float]) -> Path:
    path = Path()
    for x, y in points:
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y = x, y
        path.poses.append(pose)
    return path


class TestWays:
    grid = numpy_to_occupancy_grid(np.zeros((40, 40), np.int8), 0.5)
    quality = QualityMap(GridFrame(40, 40, 0.5))

    @pytest.mark.parametrize(
        ("points", "weight", "why"),
        [
            ([(1, math.nan), (2, 2)], 1.0, "no number"),
            ([(1, 1), (math.inf, 2)], 1.0, "no number"),
            ([(1, 1), (1e300, 2)], 1.0, "outside"),
            ([(1, 1), (2, 2)], -1.0, "weight"),
            ([(1, 1), (2, 2)], math.nan, "weight"),
            ([(1, 1)], 1.0, "two poses"),
        ],
    )
    def test_no_way(self, points: list[tuple[float, float]], weight: float, why: str):
        answer = better_way(path_of(*points), self.grid, self.quality, weight)
        assert not answer.success
        assert why in answer.message

    def test_no_place(self):
        assert not self.quality.update(math.nan, 1.0, 0.5, 0.0)
        assert not self.quality.update(1.0, math.inf, 0.5, 0.0)
        assert not self.quality.update(1.0, 1.0, math.nan, 0.0)
        assert self.quality.known_cells() == 0

    def test_a_map_that_lies_nowhere(self):
        grid = numpy_to_occupancy_grid(np.zeros((4, 4), np.int8), 0.5)
        grid.info.origin.position.x = math.nan
        assert frame_of(grid) is None

    def test_a_map_that_is_the_same_everywhere_is_crossed_straight(self):
        """On 1,000,000 cells: the bound knows what the best cell costs."""
        cells, quality = np.zeros((1000, 1000), np.int8), np.full((1000, 1000), 0.5)
        way = plan(cells, quality, (0, 0), (999, 999))
        assert way == [(index, index) for index in range(1000)]


class TestStore:
    def test_a_writer_that_repeats_one_moment_does_not_fill_it(self):
        store = MetricsStore()
        for number in range(2000):
            store.write([parse_line(f"ue,rnti=1 a={number},b=1 {NOW}")], NOW)
        (size,) = store._db.execute("SELECT max(length(fields)) FROM points").fetchone()
        assert size < 5000
        found = {v.name: v.value for v in store.last(FluxQuery("b", NOW - 1, NOW + 1, {}))}
        assert found == {"a": 1999.0, "b": 1.0}
        store.close()

    def test_what_was_written_last_is_fresh_once_whatever_its_stamp(self):
        store = MetricsStore()
        lines = (f"ue,rnti=1 a=1 {NOW + 10**15}", f"ue,rnti=1 a=2 {NOW - 10**15}", f"ue,rnti=2 a=3 {NOW}",
                 f"ue,rnti=2 b=4 {NOW}", f"other,rnti=1 a=5 {NOW}")  # fmt: skip
        store.write([parse_line(line) for line in lines], NOW)
        assert store.fresh("ue") == [
            ({"rnti": "1"}, NOW - 10**15, {"a": 2.0}),
            ({"rnti": "2"}, NOW, {"a": 3.0, "b": 4.0}),
        ]
        assert store.fresh("ue") == []
        store.close()

    @pytest.mark.parametrize("start", ["99999999999999", "-99999999999w", "-9223372037"])
    def test_a_range_beyond_all_years(self, start: str):
        with pytest.raises(BadFlux, match="beyond"):
            parse_flux(f'from(bucket: "b") |> range(start: {start}) |> last()', NOW)

    @pytest.mark.parametrize(
        ("head", "body", "status"),
        [
            ("POST /write HTTP/1.1\r\nContent-Length: \xb2", b"", 413),
            ("POST /write HTTP/1.1\r\nContent-Length: " + "0" * 30 + "9", b"", 413),
            ("GET http://[ HTTP/1.1", b"", 400),
            ("POST /write HTTP/1.1\r\nContent-Encoding: gzip", gzip.compress(b"a b=1\n" * 99)[:-9], 400),
            ("POST /api/v2/query HTTP/1.1", b'from(bucket:"b") |> range(start: -1m) |> last()', 200),
        ],
    )  # fmt: skip
    async def test_requests(self, head: str, body: bytes, status: int):
        store = MetricsStore()
        server = StoreServer(store)
        await server.start(port=0, udp_port=None)
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        length = f"\r\nContent-Length: {len(body)}" if body else ""
        writer.write(f"{head}{length}\r\n\r\n".encode("latin-1") + body)
        answer = await asyncio.wait_for(reader.readline(), 10)
        assert answer.split()[1] == str(status).encode()
        writer.close()
        await server.close()
        store.close()

    async def test_a_file_that_cannot_be_used_is_told_and_ends_nothing(
        self, caplog: pytest.LogCaptureFixture
    ):
        store = MetricsStore()
        server = StoreServer(store)
        await server.start(port=0, udp_port=0)
        store._db.close()
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        for _ in range(2):
            writer.write(b"POST /write HTTP/1.1\r\nContent-Length: 5\r\n\r\na b=1")
            assert b"503" in await asyncio.wait_for(reader.readline(), 10)
            await asyncio.wait_for(reader.readuntil(b"}"), 10)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(b"a b=1", ("127.0.0.1", server.udp_port))
            # One more answer: the datagram came before it.
            writer.write(b"GET /ping HTTP/1.1\r\n\r\n")
            assert b"204" in await asyncio.wait_for(reader.readline(), 10)
        writer.close()
        await server.close()
        assert not [item for item in caplog.records if item.exc_info]

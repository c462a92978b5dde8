"""Every example runs against a real Master and shows what it says it shows."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from support.processes import python

from simple_ros.msg.visualization_msgs import MarkerArray
from simple_ros.node import NodeHandle
from simple_ros_master import Master

EXAMPLES = Path(__file__).parents[2] / "examples"
ALONE = {
    "async_for.py": ["got 0", "got 1", "got 2"],
    "latched_map.py": ["occupied cells: [[1, 2]]"],
    "codec.py": ["as a dataclass: x 1 y 2 yaw 0.500", "as protobuf: x 1 y 2"],
    "test_with_doubles.py": [
        "heard at 1.2, 2.2, 3.2 ... 10.2 s",
        "and 10 more times while the Master was away",
    ],
    "parameters.py": [
        "declared: 2.0 m/s",
        "the mode is careful",
        "parameter 'driver/max_speed': node 'driver' refuses: 5 m/s is all",
        "the mode is bold",
        "driver/max_speed is 8.0",
        "driver/mode is bold",
        "{'max_speed': 8.0, 'mode': 'bold'}",
    ],
    "namespaces.py": [
        "robot1/driver publishes robot1/status at 2.0 m/s",
        "robot1/driver is ready",
        "robot2/driver publishes fleet/status at 1.0 m/s",
        "robot2/driver is ready",
    ],
    "components.py": ["got an image of 6220800 bytes, not copied"],
    "bag_read.py": ["3 messages of goal [geometry_msgs.Point]", "1 s: x 1", "2 s: x 2"],
    "bag_record_play.py": [
        "recorded 5 messages, dropped 0",
        *(f"heard {number}" for number in range(5)),
    ],
    "sim_time.py": ["tick at 1000.5 s", "tick at 1001.0 s", "tick at 1001.5 s"],
    "diagnostics.py": ["warn: robot: battery: 21 % left", "ok: robot: scan rate: "],
    "rosout.py": ["debug of robot: the motor turns at 900 rpm"],
    "blocking_action.py": [
        *("so far: [0, 1, 1]", "so far: [0, 1, 1, 2]", "so far: [0, 1, 1, 2, 3]"),
        "result: [0, 1, 1, 2, 3]",
    ],
    "foxglove_convert.py": [
        "/scan/scan carries foxglove.LaserScan",
        "from -0.5 to 0.5 rad in frame laser",
        "ranges [1.0, 2.0, nan]",
    ],
    "back_pressure.py": ["received 200, dropped 0"],
    "blocking_service.py": ["the lamp is on"],
    "link_shaper.py": [
        "arrived: stop, picture, picture",
        "pictures: 10 offered, 8 dropped whole",
        "commands late or lost: 0",
    ],
    "qos_events.py": ["event: IncompatibleQos(topic='range', publisher='rangefinder'"],
    "watch_graph.py": [
        "0 nodes at first",
        "node_added: visitor",
        "publisher_added: visitor greeting",
        "publisher_removed: visitor greeting",
        "node_removed: visitor",
    ],
}
TOGETHER = {
    "talker.py",
    "listener.py",
    "blocking_talker.py",
    "blocking_listener.py",
    "service_server.py",
    "service_client.py",
}
TOGETHER |= {"tf_broadcaster.py", "tf_listener.py"}
TOGETHER |= {"action_server.py", "action_client.py"}
TOGETHER |= {"foxglove_markers.py"}  # beside any viewer


def test_no_example_is_left_out() -> None:
    assert {path.name for path in EXAMPLES.glob("*.py")} == ALONE.keys() | TOGETHER


@pytest.mark.parametrize("name", ALONE)
async def test_example(master: Master, name: str) -> None:
    async with python(str(EXAMPLES / name), SIMPLE_ROS_MASTER=master.address) as process:
        for expected in ALONE[name]:
            assert (await process.line()).startswith(expected)
        assert await process.wait() == 0


@pytest.mark.parametrize("face", ["", "blocking_"])
async def test_talker_and_listener(master: Master, face: str) -> None:
    where = {"SIMPLE_ROS_MASTER": master.address}
    async with (
        python(str(EXAMPLES / f"{face}listener.py"), **where) as listener,
        python(str(EXAMPLES / f"{face}talker.py"), **where) as talker,
    ):
        for _ in range(3):
            assert (await listener.line()).startswith("heard: hello ")
        for process in (talker, listener):
            process.signal(signal.SIGINT)
            assert await process.wait() == 0
            assert await process.errors() == ""


async def test_action(master: Master) -> None:
    where = {"SIMPLE_ROS_MASTER": master.address}
    async with (
        python(str(EXAMPLES / "action_server.py"), **where) as server,
        python(str(EXAMPLES / "action_client.py"), **where) as client,
    ):
        for end in ("1]", "1, 2]", "1, 2, 3]"):
            assert await client.line() == f"so far: [0, 1, {end}"
        assert await client.line() == "result: [0, 1, 1, 2, 3]"
        assert await client.line() == "the second goal was canceled"
        assert await client.wait() == 0
        server.signal(signal.SIGINT)
        assert await server.wait() == 0
        assert await server.errors() == ""


async def test_frames(master: Master) -> None:
    where = {"SIMPLE_ROS_MASTER": master.address}
    async with (
        python(str(EXAMPLES / "tf_listener.py"), **where) as listener,
        python(str(EXAMPLES / "tf_broadcaster.py"), **where) as broadcaster,
    ):
        for _ in range(2):
            assert await listener.line() == "the camera is 1.20 m from the start"
            assert await listener.line() == "what it sees is 2.20 m from it"
        for process in (broadcaster, listener):
            process.signal(signal.SIGINT)
            assert await process.wait() == 0
            assert await process.errors() == ""


@pytest.mark.parametrize(
    ("file", "robots"), [("robot.yaml", ["robot1"]), ("fleet.py", ["robot1", "robot2"])]
)
async def test_launch_files(master: Master, tmp_path: Path, file: str, robots: list[str]) -> None:
    where = {"SIMPLE_ROS_MASTER": master.address, "SIMPLE_ROS_LOG_DIR": str(tmp_path)}
    command = ("-m", "simple_ros.cli.main", "launch", str(EXAMPLES / "launch" / file))
    async with python(*command, **where) as process:
        said = [await process.line()]
        while not said[-1].startswith("over: "):
            said.append(await process.line())
        assert await process.wait() == 0
        assert await process.errors() == ""
    assert any(line.endswith("brake: brake at 0.4 m") for line in said)
    for robot in robots:
        assert any(line.startswith(f"{robot}/range_sensor: started") for line in said)


async def test_service_and_client(master: Master) -> None:
    where = {"SIMPLE_ROS_MASTER": master.address}
    async with (
        python(str(EXAMPLES / "service_client.py"), **where) as client,
        python(str(EXAMPLES / "service_server.py"), **where) as server,
    ):
        for expected in (
            "2 + 3 = 5",
            "doubled: [0, 2, 4, 6, 8]",
            "it raised ValueError: no negative numbers",
        ):
            assert await client.line() == expected
        assert await client.wait() == 0
        server.signal(signal.SIGINT)
        assert await server.wait() == 0


async def test_shapes(master: Master) -> None:
    where = {"SIMPLE_ROS_MASTER": master.address}
    async with (
        python(str(EXAMPLES / "foxglove_markers.py"), **where) as process,
        NodeHandle("viewer", master=master.address) as node,
    ):
        assert "the 3D panel shows them as /shapes/scene" in await process.line()
        shapes = await node.subscribe("shapes", MarkerArray)
        hand, label, _ = (await shapes.receive()).markers
        assert len(hand.points) == 2
        assert label.text.endswith(" degrees")
        process.signal(signal.SIGINT)
        assert await process.wait() == 0
        assert await process.errors() == ""

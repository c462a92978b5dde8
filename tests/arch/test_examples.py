"""Every example runs against a real Master and shows what it says it shows."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from support.processes import python

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
    "components.py": ["got an image of 6220800 bytes, not copied"],
    "back_pressure.py": ["received 200, dropped 0"],
    "qos_events.py": ["event: IncompatibleQos(topic='range', publisher='rangefinder'"],
    "watch_graph.py": [
        "0 nodes at first",
        "node_added: visitor",
        "publisher_added: visitor greeting",
        "publisher_removed: visitor greeting",
        "node_removed: visitor",
    ],
}
TOGETHER = {"talker.py", "listener.py", "blocking_talker.py", "blocking_listener.py"}


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

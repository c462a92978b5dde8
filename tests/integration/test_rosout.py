"""Log lines on ``rosout``, and ``simple-ros log``."""

from __future__ import annotations

import asyncio
import json
import logging
import threading
from collections.abc import Iterator

import pytest
from support.processes import python
from support.waiting import until

from simple_ros import aio
from simple_ros.blocking import BlockingNode
from simple_ros.clock import CLOCK_TOPIC, Clock
from simple_ros.errors import ConfigError
from simple_ros.executor import Executor
from simple_ros.logs import (
    RosoutHandler,
    enable_rosout,
    enable_rosout_blocking,
    set_level,
)
from simple_ros.msg.rosgraph_msgs import Clock as ClockMsg
from simple_ros.msg.rosgraph_msgs import Log
from simple_ros.net.loop import BackgroundLoop
from simple_ros.rosout import MAX_TEXT
from simple_ros.time import Time
from simple_ros_master import Master

LOGGER = logging.getLogger("robot.test")


@pytest.fixture(autouse=True)
def levels_as_before() -> Iterator[None]:
    root = logging.getLogger()
    level = root.level
    yield
    root.setLevel(level)
    assert not [handler for handler in root.handlers if isinstance(handler, RosoutHandler)]


class Reader:
    """A node of its own that keeps what comes on rosout."""

    def __init__(self, node: aio.NodeHandle) -> None:
        self.node = node
        self.lines: list[Log] = []

    async def start(self) -> Reader:
        await self.node.subscribe("rosout", Log, self.lines.append)
        return self

    @property
    def texts(self) -> list[str]:
        return [line.msg for line in self.lines]


async def test_lines_with_all_their_facts(master: Master) -> None:
    async with (
        aio.NodeHandle("reader", master=master.address) as other,
        aio.NodeHandle("robot", master=master.address) as node,
    ):
        reader = await Reader(other).start()
        async with await enable_rosout(node) as rosout:
            await rosout.wait_for_subscribers(timeout=30)
            LOGGER.debug("not this")
            LOGGER.info("number %d", 7)
            try:
                int("broken")
            except ValueError:
                LOGGER.exception("failed")
            LOGGER.critical("x" * (MAX_TEXT + 1))
            LOGGER.warning("odd \ud800 text")
            await until(lambda: len(reader.lines) == 4)
            first, failed, long, odd = reader.lines
            assert (first.name, first.level, first.msg) == ("robot", Log.INFO, "number 7")
            assert first.file.endswith("test_rosout.py")
            assert first.function == "test_lines_with_all_their_facts"
            assert first.line > 0
            assert first.header.seq == 1
            assert first.header.stamp.seconds > 1_600_000_000
            assert list(first.topics) == ["rosout"]
            assert failed.level == Log.ERROR
            assert failed.msg.startswith("failed\nTraceback")
            assert failed.msg.endswith("int() with base 10: 'broken'")
            assert long.level == Log.FATAL
            assert len(long.msg) == MAX_TEXT + 4
            assert odd.msg == "odd \\ud800 text"
        LOGGER.error("after the end")
        assert len(reader.lines) == 4


async def test_levels_change_at_run_time(master: Master) -> None:
    async with (
        aio.NodeHandle("reader", master=master.address) as other,
        aio.NodeHandle("robot", master=master.address) as node,
    ):
        reader = await Reader(other).start()
        async with await enable_rosout(node, level="warn") as rosout:
            await rosout.wait_for_subscribers(timeout=30)
            LOGGER.info("0")
            rosout.set_level("debug")
            LOGGER.debug("1")
            set_level("error")
            LOGGER.warning("2")
            LOGGER.error("3")
            set_level(10)
            LOGGER.debug("4")
            await until(lambda: reader.texts == ["1", "3", "4"])
            with pytest.raises(ConfigError):
                rosout.set_level("loud")
            set_level("error", "robot.test")
            assert LOGGER.level == 40
            LOGGER.setLevel(0)


async def test_no_feedback(master: Master) -> None:
    """A subscription in the same process that logs what it gets; our own chatter stays at home."""
    async with aio.NodeHandle("robot", master=master.address) as node:
        got: list[str] = []

        def log_again(line: Log) -> None:
            got.append(line.msg)
            LOGGER.warning("again: %s", line.msg)

        await node.subscribe("rosout", Log, log_again)
        async with await enable_rosout(node, level="debug") as rosout:
            await rosout.wait_for_subscribers(timeout=30)
            logging.getLogger("simple_ros.peer").debug("chatter")
            logging.getLogger("simple_ros.peer").warning("worth it")
            LOGGER.warning("one")
            await until(lambda: "one" in got)
            LOGGER.warning("two")
            await until(lambda: "two" in got)
            assert "chatter" not in got
            assert "worth it" in got
            assert not [text for text in got if text.startswith("again")]


async def test_never_more_than_fits(master: Master) -> None:
    async with (
        aio.NodeHandle("reader", master=master.address) as other,
        aio.NodeHandle("robot", master=master.address) as node,
    ):
        reader = await Reader(other).start()
        async with await enable_rosout(node, capacity=10) as rosout:
            await rosout.wait_for_subscribers(timeout=30)
            for number in range(25):
                LOGGER.info("%d", number)
            assert rosout.dropped == 15
            await until(lambda: len(reader.lines) == 11)
            assert reader.texts == [*map(str, range(10)), "15 log lines were dropped here"]
            assert reader.lines[-1].level == Log.WARN


async def test_from_many_threads(master: Master) -> None:
    async with (
        aio.NodeHandle("reader", master=master.address) as other,
        aio.NodeHandle("robot", master=master.address) as node,
    ):
        reader = await Reader(other).start()
        async with await enable_rosout(node) as rosout:
            await rosout.wait_for_subscribers(timeout=30)

            def work() -> None:
                for _ in range(50):
                    LOGGER.info("work")

            threads = [threading.Thread(target=work) for _ in range(4)]
            for thread in threads:
                thread.start()
            await until(lambda: len(reader.lines) == 200)
            for thread in threads:
                thread.join()
            assert [line.header.seq for line in reader.lines] == list(range(1, 201))


async def test_stamps_are_simulated_time(master: Master) -> None:
    async with (
        aio.NodeHandle("reader", master=master.address) as other,
        aio.NodeHandle("robot", master=master.address) as node,
    ):
        Clock.attach(node).use_sim_time(True)
        ticks = await other.advertise(CLOCK_TOPIC, ClockMsg)
        await ticks.wait_for_subscribers(timeout=30)
        ticks.publish(ClockMsg(clock=Time.of(42).to_msg()))
        await until(lambda: Clock.attach(node).now() == Time.of(42))
        reader = await Reader(other).start()
        async with await enable_rosout(node) as rosout:
            await rosout.wait_for_subscribers(timeout=30)
            LOGGER.info("now")
            await until(lambda: reader.lines)
            assert reader.lines[0].header.stamp.seconds == 42


async def test_the_end_of_the_node_ends_it(master: Master) -> None:
    node = await aio.NodeHandle("robot", master=master.address).start()
    rosout = await enable_rosout(node)
    handlers = len(logging.getLogger().handlers)
    await node.close()
    await until(lambda: len(logging.getLogger().handlers) == handlers - 1)
    LOGGER.error("nobody hears this")
    await rosout.close()


def test_blocking_face() -> None:
    loop = BackgroundLoop()
    master = Master(host="127.0.0.1", port=0)
    loop.run(master.start())

    async def started() -> aio.NodeHandle:
        return await aio.NodeHandle("robot", master=master.address).start()

    node = BlockingNode(loop, Executor(), loop.run(started()))
    lines = node.subscribe("rosout", Log)
    with enable_rosout_blocking(node, level="info") as rosout:
        rosout.set_level("debug")
        rosout.wait_for_subscribers(timeout=30)
        LOGGER.debug("hello")
        assert lines.receive(30).msg == "hello"
        assert rosout.dropped == 0
    node.close()
    loop.run(master.stop())
    loop.stop()


ROBOT = """
import logging
from simple_ros import aio
from simple_ros.logs import enable_rosout

async def main():
    async with aio.NodeHandle("robot") as node:
        await enable_rosout(node)

        def tick(event):
            logging.info("all is well")
            logging.debug("a detail")
            logging.getLogger("motor").warning("motor is hot")

        node.create_timer(0.05, tick)
        print("ready", flush=True)
        await node.spin()

aio.run(main())
"""


async def outcome(master: Master, *words: str) -> tuple[int, str, str]:
    command = ("-m", "simple_ros.cli.main", "log", *words)
    async with python(*command, SIMPLE_ROS_MASTER=master.address) as process:
        out, errors = await process.process.communicate()
        return await process.wait(), out.decode(), errors.decode()


async def test_command_line(master: Master) -> None:
    async with python("-c", ROBOT, SIMPLE_ROS_MASTER=master.address) as robot:
        assert await robot.line() == "ready"
        plain, warnings, found, nothing, wrong = await asyncio.gather(
            outcome(master, "-n", "2"),
            outcome(master, "-n", "2", "--level", "warn", "--json"),
            outcome(master, "-n", "1", "--grep", "we[l]+", "--node", "/robot", "-v"),
            outcome(master, "-n", "1", "--level", "loud"),
            outcome(master, "--grep", "("),
        )
        robot.process.terminate()
        await robot.wait()
        assert b"motor is hot" in await robot.process.stderr.read()  # type: ignore[union-attr]
    assert plain[0] == 0
    assert all(" robot: " in line for line in plain[1].splitlines())
    assert [json.loads(line)["level"] for line in warnings[1].splitlines()] == ["warn", "warn"]
    assert "info  robot: all is well  (<string>:" in found[1]
    assert (nothing[0], wrong[0]) == (2, 2)
    assert "a log level is one of" in nothing[2]


async def test_other_levels_and_last_resort(
    master: Master, capsys: pytest.CaptureFixture[str]
) -> None:
    """A level that somebody sets meanwhile stays; who has set up no logging still sees warnings."""
    logger = logging.getLogger("lonely")
    logger.propagate = False
    async with (
        aio.NodeHandle("one", master=master.address) as one,
        aio.NodeHandle("two", master=master.address) as two,
    ):
        async with (
            await enable_rosout(one, logger="lonely"),
            await enable_rosout(two, logger="lonely"),
        ):
            logger.info("not on the screen")
            logger.warning("on the screen, once")
            set_level("error", "lonely")
        assert logger.level == logging.ERROR
        logger.setLevel(logging.NOTSET)
        async with await enable_rosout(one, logger="lonely"):
            assert logger.level == logging.INFO
        assert logger.level == logging.NOTSET
    assert capsys.readouterr().err == "on the screen, once\n"


async def test_set_level_from_the_command_line(master: Master) -> None:
    async with python("-c", ROBOT, SIMPLE_ROS_MASTER=master.address) as robot:
        assert await robot.line() == "ready"
        following = asyncio.create_task(outcome(master, "-n", "1", "--grep", "a detail"))
        done = await outcome(master, "set-level", "/robot", "DEBUG")
        assert done == (0, "robot logs from debug on\n", "")
        assert (await following)[1].rstrip().endswith("debug robot: a detail")
        wrong, nobody = await asyncio.gather(
            outcome(master, "set-level", "robot", "loud"),
            outcome(master, "set-level", "nobody", "info"),
        )
        assert wrong[0] == 2
        assert nobody[0] == 1
        assert "no node 'nobody' has the parameter 'log_level'" in nobody[2]

"""Simulated time: what goes by ``/clock`` and what it does then."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from support.processes import python
from support.waiting import LIMIT_S, until

from simple_ros import aio, clock
from simple_ros.arguments import Arguments
from simple_ros.blocking import Timer as BlockingTimer
from simple_ros.blocking.clock import BlockingClock
from simple_ros.clock import CLOCK_TOPIC, Clock
from simple_ros.errors import ConfigError, HandleClosed
from simple_ros.executor import Executor
from simple_ros.message_queue import DEFAULT_GROUP
from simple_ros.msg.rosgraph_msgs import Clock as ClockMsg
from simple_ros.msg.std_msgs import String
from simple_ros.net.loop import BackgroundLoop
from simple_ros.schedule import TimerEvent, TimerSchedule
from simple_ros.testing import FakeMaster, ManualClock
from simple_ros.time import ClockType, ClockTypeMismatch, Duration, Time
from simple_ros_master import Master

BEGIN = 1_700_000_000


class Simulator:
    """Publishes the time and waits until a clock has it."""

    def __init__(self, publisher: aio.Publisher[ClockMsg], follower: Clock) -> None:
        self.publisher = publisher
        self.follower = follower

    async def say(self, seconds: float) -> None:
        moment = Time.of(BEGIN) + Duration.of(seconds)
        self.publisher.publish(ClockMsg(clock=moment.to_msg()))
        await until(lambda: self.follower.now() == moment, f"time {seconds}")
        await asyncio.sleep(0)


@asynccontextmanager
async def simulation(master: Master) -> AsyncIterator[tuple[aio.NodeHandle, Simulator]]:
    async with (
        aio.NodeHandle("simulator", master=master.address) as source,
        aio.NodeHandle("robot", master=master.address) as robot,
    ):
        publisher = await source.advertise(CLOCK_TOPIC, ClockMsg)
        follower = Clock.attach(robot)
        follower.use_sim_time(True)
        await publisher.wait_for_subscribers(timeout=30)
        yield robot, Simulator(publisher, follower)


async def test_the_computers_clock_without(master: Master) -> None:
    async with aio.NodeHandle("robot", master=master.address) as robot:
        ordinary = Clock.attach(robot)
        assert Clock.attach(robot) is ordinary
        assert not ordinary.is_sim
        before = time.time_ns()
        assert before <= ordinary.now().nanoseconds <= time.time_ns()
        begun = time.monotonic()
        assert await ordinary.sleep_until(ordinary.now() + Duration.of(0.02))
        assert await ordinary.sleep_for(0.02)
        assert time.monotonic() - begun >= 0.04
        await ordinary.wait_for_clock()
        with pytest.raises(ClockTypeMismatch):
            await ordinary.sleep_until(Time.of(1, clock_type=ClockType.STEADY_TIME))


async def test_timer_goes_by_the_clock(master: Master) -> None:
    async with simulation(master) as (robot, simulator):
        events: list[TimerEvent] = []
        timer = robot.create_timer(0.1, events.append)
        await simulator.say(0)
        assert events == [], "a timer that was there before the first time starts with it"
        for step in range(1, 10):
            await simulator.say(step / 100)
        assert events == []
        await simulator.say(0.1)
        await until(lambda: len(events) == 1)
        assert events[0].current_real == pytest.approx(BEGIN + 0.1, abs=1e-6)
        assert events[0].expected_real == pytest.approx(BEGIN + 0.1, abs=1e-6)
        await simulator.say(0.55)
        await until(lambda: len(events) == 3)
        expected = [event.expected_real - BEGIN for event in events]
        assert expected == pytest.approx([0.1, 0.2, 0.5], abs=1e-6), "late, then in phase again"
        assert [event.skipped for event in events] == [0, 0, 2]
        timer.close()
        await simulator.say(0.9)
        assert len(events) == 3


async def test_steps_that_floats_cannot_hold_lose_no_call(master: Master) -> None:
    async with simulation(master) as (robot, simulator):
        events: list[TimerEvent] = []
        await simulator.say(0)
        robot.create_timer(0.1, events.append)
        for step in range(1, 101):
            await simulator.say(step / 10)
            await until(lambda step=step: len(events) == step)  # type: ignore[misc]


async def test_timer_starts_over_when_time_goes_back(master: Master) -> None:
    async with simulation(master) as (robot, simulator):
        events: list[TimerEvent] = []
        await simulator.say(100)
        robot.create_timer(1.0, events.append)
        await simulator.say(101)
        await until(lambda: len(events) == 1)
        await simulator.say(0)
        await simulator.say(0.9)
        assert len(events) == 1
        await simulator.say(1)
        await until(lambda: len(events) == 2)


async def test_coroutine_callbacks_never_overlap(master: Master) -> None:
    async with simulation(master) as (robot, simulator):
        await simulator.say(0)
        go_on = asyncio.Event()
        begun: list[int] = []

        async def slow(event: TimerEvent) -> None:
            begun.append(event.skipped)
            await go_on.wait()

        robot.create_timer(1.0, slow)
        for second in (1, 2, 3.5):
            await simulator.say(second)
        await until(lambda: begun == [0])
        go_on.set()
        await until(lambda: begun == [0, 1])


async def test_sleep_rate_and_switching(master: Master) -> None:
    async with simulation(master) as (robot, simulator):
        follower = simulator.follower
        assert follower.now() == Time()
        waiting = asyncio.create_task(follower.wait_for_clock(5))
        await simulator.say(0)
        await waiting
        sleeper = asyncio.create_task(follower.sleep_for(Duration.of(2)))
        turns = follower.rate(1.0)
        turning = asyncio.create_task(turns.sleep())
        await asyncio.sleep(0)
        await simulator.say(1)
        assert await turning is True
        assert not sleeper.done()
        await simulator.say(2)
        assert await sleeper is True
        until_later = asyncio.create_task(follower.sleep_until(follower.now() + Duration.of(9)))
        await asyncio.sleep(0)
        await simulator.say(1)
        assert await until_later is False, "time went back"
        assert await turns.sleep() is False
        forever = asyncio.create_task(follower.sleep_for(9))
        await asyncio.sleep(0)
        follower.use_sim_time(False)
        assert await forever is False, "switched"
        await until(lambda: simulator.publisher.subscriber_count == 0)
        events: list[TimerEvent] = []
        robot.create_timer(0.01, events.append)
        await until(lambda: events)
        follower.use_sim_time(True)
        await simulator.publisher.wait_for_subscribers(timeout=30)
        await simulator.say(50)


async def test_the_end_of_the_node_wakes_who_sleeps(master: Master) -> None:
    async with simulation(master) as (robot, simulator):
        await simulator.say(0)
        sleeper = asyncio.create_task(simulator.follower.sleep_for(1))
        await asyncio.sleep(0)
        await robot.close()
        with pytest.raises(HandleClosed, match="robot"):
            await sleeper
        with pytest.raises(HandleClosed):
            simulator.follower.use_sim_time(False)


async def test_bad_times_are_told_once(master: Master, caplog: pytest.LogCaptureFixture) -> None:
    async with simulation(master) as (_, simulator):
        for _ in range(2):
            bad = ClockMsg()
            bad.clock.seconds = -5
            simulator.publisher.publish(bad)
        await simulator.say(1)
        assert caplog.text.count("ignores a bad time") == 1


async def test_another_type_on_the_topic_is_told(
    master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    async with aio.NodeHandle("a", master=master.address) as node:
        await node.advertise(CLOCK_TOPIC, String)
        Clock.attach(node).use_sim_time(True)
        await until(lambda: "cannot follow simulated time" in caplog.text)


async def test_silence_is_told(
    master: Master, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(clock, "_WARN_AFTER_S", 0.05)
    monkeypatch.setenv("SIMPLE_ROS_USE_SIM_TIME", "1")
    async with aio.NodeHandle("robot", master=master.address) as node:
        events: list[TimerEvent] = []
        node.create_timer(0.001, events.append)
        await until(lambda: "nothing has come on topic '/clock'" in caplog.text)
        assert "robot" in caplog.text
        assert events == []
        node.create_timer(0.001, events.append)
        assert Clock.attach(node).is_sim
    assert [record.levelno for record in caplog.records] == [logging.WARNING]


async def test_environment_that_says_neither(
    master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SIMPLE_ROS_USE_SIM_TIME", "perhaps")
    node = aio.NodeHandle("robot", master=master.address)
    with pytest.raises(ConfigError, match="SIMPLE_ROS_USE_SIM_TIME"):
        Clock.attach(node)


def test_rate_with_the_doubles() -> None:
    """A test that moves the loop's time by hand moves sleeps and rates."""

    async def scenario(manual: ManualClock) -> None:
        async with aio.NodeHandle("robot", master=FakeMaster()) as node:
            turns: list[float] = []

            async def work() -> None:
                rate = Clock.attach(node).rate(10)
                while len(turns) < 3:
                    assert await rate.sleep()
                    turns.append(asyncio.get_running_loop().time())
                await Clock.attach(node).sleep_for(50)

            begun = asyncio.get_running_loop().time()
            working = asyncio.create_task(work())
            await manual.advance(100)
            await working
            assert [turn - begun for turn in turns] == pytest.approx([0.1, 0.2, 0.3])

    with ManualClock() as manual:
        manual.run(scenario(manual))


async def test_two_processes(master: Master) -> None:
    robot = """
        from simple_ros import aio
        from simple_ros.clock import Clock

        async def main():
            async with aio.NodeHandle("robot") as node:
                clock = Clock.attach(node)
                node.create_timer(1.0, lambda event: print(event.current_real, flush=True))
                print("ready", flush=True)
                await node.spin()

        aio.run(main())
    """
    import textwrap

    environment = {"SIMPLE_ROS_MASTER": master.address, "SIMPLE_ROS_USE_SIM_TIME": "1"}
    async with (
        aio.NodeHandle("simulator", master=master.address) as source,
        python("-c", textwrap.dedent(robot), **environment) as process,
    ):
        publisher = await source.advertise(CLOCK_TOPIC, ClockMsg)
        assert await process.line() == "ready"
        await publisher.wait_for_subscribers(timeout=30)
        for tenth in range(31):
            publisher.publish(ClockMsg(clock=Time.of(BEGIN, tenth * 100_000_000).to_msg()))
        assert [float(await process.line()) for _ in range(3)] == [BEGIN + n for n in (1, 2, 3)]


class Blocking:
    """A node on a background loop, an executor, and a simulator to move its clock by hand."""

    def __init__(self, loop: BackgroundLoop, address: str) -> None:
        self.loop = loop
        self.executor = Executor()
        self.nodes = [loop.run(self._started(name, address)) for name in ("source", "robot")]
        self.clock = BlockingClock.attach(loop, self.nodes[1])
        self.publisher = loop.run(self.nodes[0].advertise(CLOCK_TOPIC, ClockMsg))

    async def _started(self, name: str, address: str) -> aio.NodeHandle:
        return await aio.NodeHandle(name, master=address).start()

    def say(self, seconds: float) -> None:
        moment = Time.of(BEGIN) + Duration.of(seconds)
        self.loop.call_soon(self.publisher.publish, ClockMsg(clock=moment.to_msg()))
        end = time.monotonic() + LIMIT_S
        while self.clock.now() != moment:
            assert time.monotonic() < end
            time.sleep(0.001)

    def close(self) -> None:
        for node in self.nodes:
            self.loop.run(node.close())


def test_blocking_face() -> None:
    loop = BackgroundLoop()
    master = Master(host="127.0.0.1", port=0)
    loop.run(master.start())
    world = Blocking(loop, master.address)
    events: list[TimerEvent] = []
    timer = BlockingTimer(
        world.executor, TimerSchedule(1.0), events.append, DEFAULT_GROUP, world.clock.clock
    )
    timer.start()
    world.clock.use_sim_time(True)
    loop.run(world.publisher.wait_for_subscribers(timeout=30))
    assert world.clock.is_sim
    world.say(100)
    world.clock.wait_for_clock(5)
    assert world.executor.spin_once(0.02) == 0
    world.say(101)
    assert world.executor.spin_once(5) == 1
    assert events[0].current_real == BEGIN + 101
    assert world.executor.spin_once(0.02) == 0
    world.say(0)
    world.say(0.5)
    assert world.executor.spin_once(0.0) == 0, "it starts over when it is next looked at"
    world.say(1.5)
    assert world.executor.spin_once(5) == 1
    timer.pause()
    timer.resume()
    timer.period = 0.5
    assert timer.is_running
    world.say(2.0)
    assert world.executor.spin_once(5) == 1
    turns = world.clock.rate(1.0)  # a turn that is over before it is slept for is no sleep
    world.clock.use_sim_time(False)
    assert turns.sleep() is False, "switched"
    assert turns.sleep() is True
    assert world.clock.sleep_for(0.01) is True
    assert world.clock.sleep_until(world.clock.now() + Duration.of(0.01)) is True
    assert world.executor.spin_once(5) == 1, "goes on by the computer's clock"
    timer.close()
    world.close()
    loop.run(master.stop())
    loop.stop()


async def test_the_parameter_switches_simulated_time(master: Master) -> None:
    told = Arguments.parse(["_use_sim_time:=true"])
    async with (
        aio.NodeHandle("robot", master=master.address, arguments=told) as robot,
        aio.NodeHandle("operator", master=master.address) as operator,
    ):
        assert robot.clock.is_sim
        await until(lambda: "~use_sim_time" in robot.parameters)
        assert await operator.get_parameter("/robot/use_sim_time") is True
        await operator.set_parameters({"/robot/use_sim_time": False})
        await until(lambda: not robot.clock.is_sim)

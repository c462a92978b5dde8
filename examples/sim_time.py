"""Simulated time: a simulator publishes /clock, and a node's timer goes by it, ten times too fast."""

import asyncio

from simple_ros import TimerEvent, aio
from simple_ros.clock import CLOCK_TOPIC, Clock
from simple_ros.msg.rosgraph_msgs import Clock as ClockMsg
from simple_ros.time import Duration, Time


async def simulate(publisher: aio.Publisher[ClockMsg]) -> None:
    now = Time.of(1000)
    while True:
        publisher.publish(ClockMsg(clock=now.to_msg()))
        now += Duration.of(0.01)
        await asyncio.sleep(0.001)


def tick(event: TimerEvent) -> None:
    print(f"tick at {event.current_real:.1f} s")


async def main() -> None:
    async with aio.NodeHandle("simulator") as simulator, aio.NodeHandle("robot") as robot:
        clock = Clock.attach(robot)
        clock.use_sim_time(True)  # or SIMPLE_ROS_USE_SIM_TIME=1 in the environment
        publisher = await simulator.advertise(CLOCK_TOPIC, ClockMsg)
        await publisher.wait_for_subscribers()
        running = asyncio.create_task(simulate(publisher))
        robot.create_timer(0.5, tick)
        await clock.wait_for_clock()
        await clock.sleep_until(Time.of(1001.7))
        running.cancel()


aio.run(main())

"""The node ``quad_simulator``: publishes where a quadrotor on a circle is, 50 times a second."""

from __future__ import annotations

from simple_ros import aio
from simple_ros.demos.program import run_node
from simple_ros.demos.quadrotor import odometry, state_at
from simple_ros.msg.geometry_msgs import Odometry

PERIOD_S = 0.02


async def main(master: str | None = None) -> None:
    """Publish `Odometry` on ``quad_odometry`` until cancelled."""
    async with aio.NodeHandle("quad_simulator", master=master) as node:
        publisher = await node.advertise("quad_odometry", Odometry)
        step = -1

        def publish(event: aio.TimerEvent) -> None:
            nonlocal step
            step += 1 + event.skipped
            publisher.publish(odometry(state_at(step * PERIOD_S)))

        node.create_timer(PERIOD_S, publish)
        await node.spin()


if __name__ == "__main__":
    run_node("Simulate a quadrotor that flies a circle.", main)

"""Drives in a circle: 20 commands a second, by whatever network there is."""

from simple_ros import TimerEvent, aio
from simple_ros.msg.geometry_msgs import Twist


async def main() -> None:
    async with aio.NodeHandle("driver") as node:
        commands = await node.advertise("cmd_vel_qos", Twist)
        circle = Twist(linear={"x": 0.5}, angular={"z": 0.2})

        def drive(event: TimerEvent) -> None:
            commands.publish(circle)

        node.create_timer(0.05, drive)
        await node.spin()


aio.run(main())

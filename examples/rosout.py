"""Logging: what a program logs goes to the topic rosout; see it with `simple-ros log`."""

import logging

from simple_ros import aio
from simple_ros.log_levels import level_name
from simple_ros.logs import enable_rosout, set_level
from simple_ros.msg.rosgraph_msgs import Log

logger = logging.getLogger("motor")


async def main() -> None:
    async with aio.NodeHandle("robot") as robot, aio.NodeHandle("operator") as operator:
        lines = await operator.subscribe("rosout", Log)
        async with await enable_rosout(robot, level="info") as rosout:
            await rosout.wait_for_subscribers(timeout=5)
            logger.debug("not shown: below info")
            set_level("debug")
            logger.debug("the motor turns at %d rpm", 900)
            line = await lines.receive()
            print(f"{level_name(line.level)} of {line.name}: {line.msg}")


aio.run(main())

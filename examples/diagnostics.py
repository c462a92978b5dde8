"""Diagnostics: a node says how it is, another one listens."""

from simple_ros import TimerEvent, aio
from simple_ros.diagnostics import WARN, DiagnosticUpdater, FrequencyMonitor, Status
from simple_ros.diagnostics.status import level_name
from simple_ros.msg.diagnostic_msgs import DiagnosticArray


def battery(status: Status) -> None:
    status.summary(WARN, "21 % left")
    status.add("voltage (V)", 22.1)


async def main() -> None:
    async with aio.NodeHandle("robot") as robot, aio.NodeHandle("operator") as operator:
        arrays = await operator.subscribe("diagnostics", DiagnosticArray)
        updater = await DiagnosticUpdater.create(robot, period_s=0.2)
        rate = FrequencyMonitor(min_hz=50)
        updater.add("battery", battery)
        updater.add("scan rate", rate)

        def scan(event: TimerEvent) -> None:
            rate.tick(updater.now())

        robot.create_timer(0.01, scan)
        for status in (await arrays.receive()).status:
            print(f"{level_name(status.level)}: {status.name}: {status.message}")


aio.run(main())

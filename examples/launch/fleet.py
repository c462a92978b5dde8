"""A launch file in Python, for what needs a loop: several robots, each as in robot.yaml.

``simple-ros launch examples/launch/fleet.py robots:=3``
"""

from typing import Any

from simple_ros.launch.entries import argument, include

ARGS = {"robots": argument(type="int", default=2, description="How many robots.")}


def launch(args: dict[str, Any]) -> list[Any]:
    return [
        include("robot.yaml", args={"robot": f"robot{number}"})
        for number in range(1, args["robots"] + 1)
    ]

"""The bridge in a graph of unmodified C++ simple_ros programs: their Master, their simulator.

See `test_cpp_programs` for what that needs.
"""

from __future__ import annotations

import json
import os
import sys
import textwrap
from pathlib import Path

import pytest

if "SIMPLE_ROS_CPP_BIN" not in os.environ:
    pytest.skip("SIMPLE_ROS_CPP_BIN names no C++ programs", allow_module_level=True)

from interop.test_cpp_programs import OUR_VISUALIZER, cpp, line, running, space, started_cpp_master

__all__ = ["space"]

BRIDGE = [sys.executable, "-m", "simple_ros.cli.main", "foxglove", "--port", "8765"]
TESTS = str(Path(__file__).parents[1])
APP = """
    import asyncio, json, sys
    sys.path.insert(0, sys.argv[1])
    from support.foxglove import connected
    from support.waiting import until

    TOPICS = ("/quad_odometry", "/quad_marker_array/scene", "/quad_path_incremental/scene")

    async def main():
        async with connected(8765) as client:
            await client.subscribe(TOPICS[0])
            print("the simulator is there", flush=True)
            for topic in TOPICS[1:]:
                await client.subscribe(topic)
            await until(lambda: all(client.on(topic)[9:] for topic in TOPICS))
            odometry = client.decoder(TOPICS[0]).FromString(client.on(TOPICS[0])[-1])
            scene = client.decoder(TOPICS[1]).FromString(client.on(TOPICS[1])[-1])
            await client.advertise(1, "/from_app", "std_msgs/String")
            await client.publish(1, b'{"data": "x"}')
            await client.channel("/from_app")
            await client.say("subscribeConnectionGraph")
            await until(lambda: client.heard("connectionGraphUpdate"))
            await client.say("getParameters", parameterNames=[], id="all")
            await until(lambda: client.heard("parameterValues"))
            print(json.dumps({
                "radius": (odometry.pose.position.x ** 2 + odometry.pose.position.y ** 2) ** 0.5,
                "entities": [[entity.id, entity.frame_id] for entity in scene.entities],
                "published": client.heard("connectionGraphUpdate")[0]["publishedTopics"],
                "parameters": client.parameters("all"),
                "statuses": client.statuses(),
            }))

    asyncio.run(main())
"""


@pytest.mark.slow
async def test_a_cpp_node_under_its_own_master(space: list[str]) -> None:
    async with running(space, *cpp("master")) as master:
        await started_cpp_master(master, space)
        async with running(space, *BRIDGE) as bridge:
            await line(bridge, "listening at")
            script = textwrap.dedent(APP)
            async with (
                running(space, *cpp("quad_simulator")),
                running(space, sys.executable, "-c", script, TESTS) as app,
            ):
                await line(app, "the simulator is there")
                # Not theirs: it makes three calls at once, which kills their Master now and then.
                async with running(space, *OUR_VISUALIZER):
                    seen = json.loads(await line(app, "{"))
    assert 1.5 < seen["radius"] < 2.5
    assert ["quadrotor_0", "world"] in seen["entities"]
    assert {"name": "/quad_odometry", "publisherIds": ["/quad_simulator"]} in seen["published"]
    assert seen["parameters"] == []
    assert seen["statuses"] == [], "a Master without parameters is no error"

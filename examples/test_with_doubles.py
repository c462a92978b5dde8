"""Test a node with no Master, no network and no waiting: ten seconds pass in a few milliseconds."""

from simple_ros.aio import NodeHandle
from simple_ros.msg.std_msgs import String
from simple_ros.testing import FakeMaster, ManualClock, MemoryNetwork


async def heartbeat(node):
    """What is tested: a node that says every second that it is alive."""
    publisher = await node.advertise("alive", String)
    node.create_timer(1.0, lambda event: publisher.publish(String(data=node.name)))


async def scenario(clock):
    master = FakeMaster()
    network = MemoryNetwork(delay_s=0.2)
    heard = []
    async with (
        NodeHandle("robot", master=master, transports=[network]) as robot,
        NodeHandle("observer", master=master, transports=[network]) as observer,
    ):
        await observer.subscribe("alive", String, lambda message: heard.append(clock.now))
        await heartbeat(robot)
        await clock.advance(10.5)
        print(f"heard at {', '.join(f'{time:g}' for time in heard[:3])} ... {heard[-1]:g} s")
        with master.outage():
            await clock.advance(10)
        print(f"and {len(heard) - 10} more times while the Master was away")


with ManualClock() as clock:
    clock.run(scenario(clock))

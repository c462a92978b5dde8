"""Doubles for tests of programs built on simple_ros: no Master process, no network, no waiting.

::

    from simple_ros.testing import FakeMaster, ManualClock, MemoryNetwork

    def test_my_node():
        with ManualClock() as clock:
            clock.run(scenario(clock))

    async def scenario(clock):
        master, network = FakeMaster(), MemoryNetwork(delay_s=0.05, loss=0.1, seed=1)
        async with NodeHandle("a", master=master, transports=[network]) as a: ...
        await clock.advance(1.0)

They are doubles: `FakeMaster` matches topics and no more, `MemoryNetwork` is a simulated network.
"""

from simple_ros.testing.clock import ManualClock
from simple_ros.testing.fake_master import FakeMaster
from simple_ros.testing.network import MemoryNetwork

__all__ = ["FakeMaster", "ManualClock", "MemoryNetwork"]

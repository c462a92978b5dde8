"""The blocking face with little ceremony: a named NodeHandle starts everything; how such programs end."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.processes import program
from support.waiting import until

from simple_ros import aio
from simple_ros.msg.std_msgs import String
from simple_ros.net.loop import BackgroundLoop
from simple_ros.system_manager import NodeHandle, SystemManager
from simple_ros_master import Master


@pytest.fixture
def address() -> Iterator[str]:
    """A Master on a loop and thread of its own; what the test has started ends before it."""
    loop = BackgroundLoop()
    master = Master(host="127.0.0.1", port=0)
    loop.run(master.start())
    yield master.address
    SystemManager.instance().shutdown()
    loop.run(master.stop())
    loop.stop()


def test_a_named_handle_starts_the_process_and_a_second_one_a_further_node(address: str) -> None:
    system = SystemManager.instance()
    with pytest.raises(RuntimeError, match=r"NodeHandle\(name\) or SystemManager.init\(name\)"):
        NodeHandle()
    talker = NodeHandle("talker", master=address, max_message_bytes=1000)
    listener = NodeHandle("listener", master=address)
    assert system.is_running
    assert system.get_node_info().node_name == NodeHandle().name == "talker"
    assert listener.port != talker.port
    heard: list[str] = []

    def hear(message: String) -> None:
        heard.append(message.data)
        system.shutdown()

    listener.subscribe("chatter", String, hear)
    publisher = talker.advertise("chatter", String)
    publisher.wait_for_subscribers(1, timeout=30)
    publisher.publish(String(data="hello"))
    talker.spin()
    assert heard == ["hello"]
    assert not system.is_running


def test_handles_close_twice_and_the_next_name_starts_anew(address: str) -> None:
    system = SystemManager.instance()
    with NodeHandle("first", master=address) as first, NodeHandle("other", master=address) as other:
        other.close()
        other.close()
        assert system.is_running
    first.close()
    assert not system.is_running
    with NodeHandle("second", master=address) as second:
        assert system.get_node_info().node_name == "second"
        second.create_timer(0.01, lambda event: system.shutdown())
        second.spin()
    system.init("third", master=address)
    assert NodeHandle().name == "third"


LOSES_ITS_NAME = """
    from simple_ros import NodeHandle

    node = NodeHandle("talker")
    node.wait_for_master(30)
    print("ready", flush=True)
    node.spin()
"""


async def test_a_program_that_loses_its_name_ends_with_one_line(master: Master) -> None:
    async with program(LOSES_ITS_NAME, master=master.address) as first:
        assert await first.line() == "ready"
        async with aio.NodeHandle("talker", master=master.address) as second:
            assert await first.wait() == 1
            expected = (
                f"node name 'talker' was taken over by a newer node at 127.0.0.1:{second.port}"
            )
            # The log says it as well, and without a configuration that is the same line.
            assert set((await first.errors()).splitlines()) == {expected}


async def test_other_errors_keep_their_traceback(master: Master) -> None:
    text = """
        from simple_ros import NodeHandle
        NodeHandle("talker")
        raise LookupError("mine")
    """
    async with program(text, master=master.address) as child:
        assert await child.wait() == 1
        errors = await child.errors()
    assert errors.startswith("Traceback")
    assert errors.endswith("LookupError: mine\n")


SLOW_TO_CLOSE = """
    import asyncio, sys
    from pathlib import Path
    from simple_ros import NodeHandle, SystemManager, aio

    class Slow(aio.NodeHandle):
        async def _close(self, caller):
            print("closing", flush=True)
            while not Path(sys.argv[2]).exists():
                await asyncio.sleep(0.01)
            await super()._close(caller)

    import simple_ros.system_manager
    simple_ros.system_manager.AsyncNodeHandle = Slow
    node = NodeHandle("slow")
    node.wait_for_master(30)
    print("ready", flush=True)
    node.spin()
    if sys.argv[1] == "explicit":
        SystemManager.instance().shutdown()
        print("not reached", flush=True)
"""


@pytest.mark.parametrize("how", ["explicit", "at exit"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
async def test_a_second_signal_does_not_disturb_the_goodbye(
    how: str, number: signal.Signals, master: Master, tmp_path: Path
) -> None:
    go_on = tmp_path / "go on"
    async with program(SLOW_TO_CLOSE, how, str(go_on), master=master.address) as child:
        assert await child.line() == "ready"
        child.signal(number)
        assert await child.line() == "closing"
        child.signal(number)
        child.signal(signal.SIGINT)
        go_on.touch()
        assert await child.wait() == 0
        assert await child.errors() == ""
        assert child.process.stdout is not None
        assert await child.process.stdout.read() == b""
    await until(lambda: not list(master.graph.nodes()), "the Master knows that it has ended")

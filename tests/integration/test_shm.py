"""Large messages in shared memory: between processes, when they die, and when it is not to be had."""

from __future__ import annotations

import asyncio
import gc
import signal
import socket
from pathlib import Path

import numpy as np
import pytest
from support.processes import program
from support.waiting import Stopwatch, until

from simple_ros import QosProfile
from simple_ros.aio import NodeHandle
from simple_ros.large import LargeMessage, large
from simple_ros.msg.sensor_msgs import Image
from simple_ros.net.shm import _arena, is_available
from simple_ros.net.unix import unix_path
from simple_ros_master.server import Master

pytestmark = pytest.mark.skipif(not is_available(), reason="this system cannot share memory")

LargeImage = large(Image)
SHM = ("shm",)
SIZE = 1024 * 1024

HOLDER = """
    import asyncio, sys
    from simple_ros.aio import NodeHandle
    from simple_ros.large import large
    from simple_ros.msg.sensor_msgs import Image

    held = []

    def take(image):
        held.append(image)
        print(image.height, image.data[0], len(held), flush=True)

    async def main():
        async with NodeHandle("holder", transports=("shm",)) as node:
            await node.subscribe("image", large(Image), take)
            print("ready", flush=True)
            await asyncio.Event().wait()

    asyncio.run(main())
"""
CAMERA = """
    import asyncio, os, signal
    from simple_ros.aio import NodeHandle
    from simple_ros.large import large
    from simple_ros.msg.sensor_msgs import Image

    async def main():
        LargeImage = large(Image)
        async with NodeHandle("camera", transports=("shm",)) as node:
            publisher = await node.advertise("image", LargeImage)
            await publisher.wait_for_subscribers(1)
            for number in range(1, 4):
                publisher.publish(LargeImage(Image(height=number), bytes([number]) * 1048576))
            os.kill(os.getpid(), signal.SIGKILL)

    asyncio.run(main())
"""


def image(number: int, size: int = SIZE) -> LargeMessage[Image]:
    return LargeImage(Image(height=number), np.full(size, number % 256, np.uint8))


async def test_a_subscriber_killed_with_views_in_its_hands_gives_its_slots_back(
    master: Master,
) -> None:
    async with NodeHandle("camera", master=master.address, transports=SHM) as camera:
        publisher = await camera.advertise("image", LargeImage)
        for _ in range(3):
            async with program(HOLDER, master=master.address) as holder:
                assert await holder.line() == "ready"
                await publisher.wait_for_subscribers(1, timeout=30)
                for number in range(1, 11):
                    publisher.publish(image(number))
                    await publisher.flush(5)
                    assert await holder.line() == f"{number} {number} {number}"
                assert _arena().busy_slots == 10
                holder.signal(signal.SIGKILL)
                await until(lambda: publisher.subscriber_count == 0)
            await until(lambda: _arena().busy_slots == 0)
        assert publisher.statistics.dropped == 0


async def test_what_a_subscriber_holds_outlives_a_publisher_that_is_killed(
    master: Master,
) -> None:
    got: list[LargeMessage[Image]] = []
    async with NodeHandle("viewer", master=master.address, transports=SHM) as viewer:
        await viewer.subscribe("image", LargeImage, got.append)
        async with program(CAMERA, master=master.address) as camera:
            assert await camera.wait() == -signal.SIGKILL
        await until(lambda: len(got) == 3)
        for number, message in enumerate(got, 1):
            pixels = np.frombuffer(message.data, np.uint8)
            assert (message.height, pixels.min(), pixels.max()) == (number, number, number)


async def test_held_views_never_change_and_all_else_goes_on(
    master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SIMPLE_ROS_SHM_MB", "8")
    got: list[LargeMessage[Image]] = []
    async with (
        NodeHandle("camera", master=master.address, transports=SHM) as camera,
        NodeHandle("viewer", master=master.address, transports=SHM) as viewer,
    ):
        await viewer.subscribe("image", LargeImage, got.append)
        publisher = await camera.advertise("image", LargeImage)
        await publisher.wait_for_subscribers(1, timeout=30)
        # Far more than is shared: the rest goes through the socket.
        for number in range(40):
            publisher.publish(image(number))
            await publisher.flush(5)
            await until(lambda number=number: len(got) == number + 1)
        assert _arena().shared_bytes <= 8 * SIZE
        for number, message in enumerate(got):
            pixels = np.frombuffer(message.data, np.uint8)
            assert (pixels.min(), pixels.max()) == (number, number)
        got.clear()
        del message, pixels
        gc.collect()
        assert _arena().busy_slots == 0


async def test_three_subscribers_look_at_one_copy(master: Master) -> None:
    got: dict[int, list[LargeMessage[Image]]] = {number: [] for number in range(3)}
    async with (
        NodeHandle("camera", master=master.address, transports=SHM) as camera,
        NodeHandle("a", master=master.address, transports=SHM) as a,
        NodeHandle("b", master=master.address, transports=SHM) as b,
        NodeHandle("c", master=master.address, transports=SHM) as c,
    ):
        for number, node in enumerate((a, b, c)):
            await node.subscribe("image", LargeImage, got[number].append)
        publisher = await camera.advertise("image", LargeImage)
        await publisher.wait_for_subscribers(3, timeout=30)
        for number in range(5):
            publisher.publish(image(number))
            await until(lambda number=number: all(len(one) == number + 1 for one in got.values()))
        assert _arena().busy_slots == 5
        del got[0][:], got[1][:]
        assert _arena().busy_slots == 5
        got[2].clear()
        assert _arena().busy_slots == 0


@pytest.mark.parametrize("depth", [1, 10])
async def test_a_slow_subscriber_gets_the_newest_and_a_blocking_publisher_waits(
    master: Master, depth: int
) -> None:
    async with (
        NodeHandle("camera", master=master.address, transports=SHM) as camera,
        NodeHandle("viewer", master=master.address, transports=SHM) as viewer,
    ):
        newest = QosProfile(depth=depth)
        block = QosProfile(depth=depth, overflow="block")
        latest = await camera.advertise("latest", LargeImage, qos=newest)
        whole = await camera.advertise("whole", LargeImage, qos=block)
        seen_latest = await viewer.subscribe("latest", LargeImage, qos=block)
        seen_whole = await viewer.subscribe("whole", LargeImage, qos=block)
        for publisher in (latest, whole):
            await publisher.wait_for_subscribers(1, timeout=30)
        for number in range(60):
            latest.publish(image(number, 3 * SIZE))
        assert latest.statistics.dropped >= 60 - 2 * depth - 10

        async def send_all() -> None:
            for number in range(60):
                await whole.publish_async(image(number, 3 * SIZE))

        sending = asyncio.create_task(send_all())
        numbers = [(await seen_whole.receive_within(30)).height for _ in range(60)]
        await sending
        assert numbers == list(range(60))
        assert whole.statistics.dropped == 0
        last = -1
        while last < 59:
            message = await seen_latest.receive_within(30)
            assert message.height > last
            assert message.data[0] == message.height
            last = message.height


async def test_without_shared_memory_the_next_transport_carries(
    master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SIMPLE_ROS_SHM_MB", "0")
    got: list[LargeMessage[Image]] = []
    both = ("shm", "unix")
    async with (
        NodeHandle("camera", master=master.address, transports=both) as camera,
        NodeHandle("viewer", master=master.address, transports=both) as viewer,
    ):
        await viewer.subscribe("image", LargeImage, got.append)
        publisher = await camera.advertise("image", LargeImage)
        await publisher.wait_for_subscribers(1, timeout=30)
        publisher.publish(image(7))
        await until(lambda: got)
        assert got[0].data[5] == 7


async def test_a_stranger_on_the_socket_is_turned_away(master: Master) -> None:
    async with NodeHandle("viewer", master=master.address, transports=SHM) as viewer:
        subscriber = await viewer.subscribe("image", LargeImage)
        (address,) = [
            each for each in viewer.identity.node_info().addresses if each.startswith("shm:")
        ]
        for greeting, fds in (
            (b"GET / HTTP/1.1\r\n\r\n", []),
            (b"srosshm1" + bytes(24), []),
            (b"", []),
        ):
            sock = socket.socket(socket.AF_UNIX)
            sock.connect(unix_path(address))
            if greeting:
                socket.send_fds(sock, [greeting], fds)
            sock.shutdown(socket.SHUT_WR)
            reader, writer = await asyncio.open_unix_connection(sock=sock)
            assert await asyncio.wait_for(reader.read(), 30) == b""
            writer.close()
        async with NodeHandle("camera", master=master.address, transports=SHM) as camera:
            publisher = await camera.advertise("image", LargeImage)
            publisher.publish(image(2))
            await publisher.wait_for_subscribers(1, timeout=30)
            assert (await subscriber.receive_within(30)).height == 2


async def test_nothing_is_left_open_when_nodes_have_come_and_gone(master: Master) -> None:
    async def once() -> None:
        async with (
            NodeHandle("camera", master=master.address, transports=SHM) as camera,
            NodeHandle("viewer", master=master.address, transports=SHM) as viewer,
        ):
            subscriber = await viewer.subscribe("image", LargeImage)
            publisher = await camera.advertise("image", LargeImage)
            await publisher.wait_for_subscribers(1, timeout=30)
            publisher.publish(image(1))
            await subscriber.receive_within(30)

    def open_files() -> int:
        gc.collect()
        return len(list(Path("/proc/self/fd").iterdir()))

    await once()
    before = open_files()
    for _ in range(5):
        await once()
    await until(lambda: open_files() <= before)


async def test_a_stranger_who_says_nothing_does_not_hold_up_the_end(master: Master) -> None:
    async with NodeHandle("viewer", master=master.address, transports=SHM) as viewer:
        await viewer.subscribe("image", LargeImage)
        (address,) = [
            each for each in viewer.identity.node_info().addresses if each.startswith("shm:")
        ]
        reader, writer = await asyncio.open_unix_connection(unix_path(address))
        # The node has accepted it: nothing else waits for a greeting here.
        await until(lambda: any("_take" in repr(task) for task in asyncio.all_tasks()))
        watch = Stopwatch()
        await viewer.close()
        assert watch.seconds < 2
        assert await asyncio.wait_for(reader.read(), 30) == b""
        writer.close()

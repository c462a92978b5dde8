"""Large messages: the same bytes for everybody, copied by nobody."""

from __future__ import annotations

import asyncio
import socket

import numpy as np
import pytest
from support.waiting import until

from simple_ros import LATCHED, Durability, HandleClosed, QosProfile, QueueFull
from simple_ros.aio import NodeHandle
from simple_ros.large import LargeMessage, large
from simple_ros.msg.arrays import image_to_numpy
from simple_ros.msg.sensor_msgs import Image
from simple_ros.wire.session import Target
from simple_ros_master.server import Master

LargeImage = large(Image)
TCP = ("tcp",)
HEIGHT, WIDTH = 480, 640


def image(value: int) -> tuple[Image, np.ndarray]:
    pixels = np.full((HEIGHT, WIDTH, 3), value, np.uint8)
    return Image(height=HEIGHT, width=WIDTH, encoding="rgb8", step=WIDTH * 3), pixels


@pytest.mark.parametrize("transports", [TCP, ("local",), ("reference",)])
async def test_arrays_go_in_and_come_out_and_others_get_the_plain_message(
    master: Master, transports: tuple[str, ...]
) -> None:
    arrays: list[LargeMessage[Image]] = []
    plain: list[Image] = []
    async with (
        NodeHandle("camera", master=master.address, transports=transports) as camera,
        NodeHandle("viewer", master=master.address, transports=transports) as viewer,
    ):
        await viewer.subscribe("image", LargeImage, arrays.append)
        await viewer.subscribe("image", Image, plain.append)
        publisher = await camera.advertise("image", LargeImage)
        other = await camera.advertise("image", Image)
        await publisher.wait_for_subscribers(1, timeout=30)
        await other.wait_for_subscribers(1, timeout=30)
        for value in range(8):
            fields, pixels = image(value)
            publisher.publish(LargeImage(fields, pixels))
            await publisher.flush(5)
            if transports == TCP:
                # The array is the user's again.
                pixels[:] = 255
            await until(lambda value=value: len(plain) == len(arrays) == value + 1)
        assert [image_to_numpy(item).max() for item in arrays] == list(range(8))
        assert [int(np.frombuffer(item.data, np.uint8).min()) for item in arrays] == list(range(8))
        assert arrays[3].to_message() == plain[3]
        fields, pixels = image(9)
        fields.data = pixels.tobytes()
        await other.publish_async(fields)
        await until(lambda: len(arrays) == 9)
        assert arrays[8].to_message() == fields
        assert arrays[0].data[0] == 0


async def test_small_ones_latched_ones_and_slow_subscribers(master: Master) -> None:
    got: list[LargeMessage[Image]] = []
    async with (
        NodeHandle("camera", master=master.address, transports=TCP) as camera,
        NodeHandle("viewer", master=master.address, transports=TCP) as viewer,
    ):
        latched = await camera.advertise("map", LargeImage, qos=LATCHED)
        latched.publish(LargeImage(*image(3)))
        late = QosProfile(durability=Durability.TRANSIENT_LOCAL)
        await viewer.subscribe("map", LargeImage, got.append, qos=late)
        await until(lambda: got)
        assert got[0].data[100] == 3
        block = QosProfile(depth=2, overflow="block")
        subscriber = await viewer.subscribe("image", LargeImage, qos=block)
        publisher = await camera.advertise("image", LargeImage, qos=block)
        await publisher.wait_for_subscribers(1, timeout=30)
        publisher.publish(LargeImage(Image(height=1), b"tiny"))
        assert bytes((await subscriber.receive_within(30)).data) == b"tiny"
        sent = 0
        with pytest.raises(QueueFull):
            for sent in range(200):
                publisher.publish(LargeImage(*image(sent % 256)))
        waiting = asyncio.create_task(publisher.publish_async(LargeImage(*image(99))))
        for number in range(sent):
            assert (await subscriber.receive_within(30)).data[7] == number % 256
        await waiting
        assert (await subscriber.receive_within(30)).data[7] == 99
        assert publisher.statistics.published == sent + 2
        assert publisher.statistics.dropped == 0


BLOCK = QosProfile(depth=2, overflow="block")


def full_hd(pixels: np.ndarray) -> LargeMessage[Image]:
    return LargeImage(Image(height=1080, width=1920, encoding="rgb8", step=1920 * 3), pixels)


@pytest.mark.parametrize("transports", [TCP, ("unix",), ("shm", "unix"), ("local",)])
async def test_one_array_for_all_images_is_free_when_publish_async_returns(
    master: Master, transports: tuple[str, ...]
) -> None:
    pixels = np.zeros((1080, 1920, 3), np.uint8)
    async with (
        NodeHandle("camera", master=master.address, transports=transports) as camera,
        NodeHandle("viewer", master=master.address, transports=transports) as viewer,
        NodeHandle("recorder", master=master.address, transports=transports) as recorder,
    ):
        subscribers = [
            await node.subscribe("image", LargeImage, qos=BLOCK) for node in (viewer, recorder)
        ]
        publisher = await camera.advertise("image", LargeImage, qos=BLOCK)
        await publisher.wait_for_subscribers(2, timeout=30)

        async def film() -> None:
            for value in range(20):
                pixels[:] = value
                await publisher.publish_async(full_hd(pixels))

        filming = asyncio.create_task(film())
        for value in range(20):
            for subscriber in subscribers:
                seen = np.frombuffer((await subscriber.receive_within(30)).data, np.uint8)
                assert (int(seen.min()), int(seen.max())) == (value, value)
        await filming


async def test_a_cancelled_publish_async_leaves_the_array_free_and_the_image_whole(
    master: Master,
) -> None:
    pixels = np.full((1080, 1920, 3), 7, np.uint8)
    async with (
        NodeHandle("camera", master=master.address, transports=TCP) as camera,
        NodeHandle("viewer", master=master.address, transports=TCP) as viewer,
    ):
        subscriber = await viewer.subscribe("image", LargeImage, qos=BLOCK)
        publisher = await camera.advertise("image", LargeImage, qos=BLOCK)
        await publisher.wait_for_subscribers(1, timeout=30)
        # Nobody reads yet: sooner or later one waits in the middle of its image.
        sent = 0
        while True:
            pixels[:] = sent
            publishing = asyncio.create_task(publisher.publish_async(full_hd(pixels)))
            await asyncio.wait([publishing], timeout=0.5)
            if not publishing.done():
                break
            sent += 1
        publishing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await publishing
        begun = publisher.statistics.published
        assert begun in {sent, sent + 1}
        pixels[:] = 255
        for value in range(begun):
            seen = np.frombuffer((await subscriber.receive_within(30)).data, np.uint8)
            assert (int(seen.min()), int(seen.max())) == (value, value)


async def test_publish_async_goes_on_without_a_reader_that_hangs_once_it_is_taken_away(
    master: Master,
) -> None:
    pixels = np.zeros((1080, 1920, 3), np.uint8)
    with socket.create_server(("127.0.0.1", 0)) as hangs:
        target = Target("127.0.0.1", hangs.getsockname()[1])
        async with NodeHandle("camera", master=master.address, transports=TCP) as camera:
            publisher = await camera.advertise("image", LargeImage, qos=BLOCK)
            publisher.targets_update((target,))
            await publisher.wait_for_subscribers(1, timeout=30)
            while True:
                publishing = asyncio.create_task(publisher.publish_async(full_hd(pixels)))
                await asyncio.wait([publishing], timeout=0.5)
                if not publishing.done():
                    break
            publisher.targets_update((), (target,))
            async with asyncio.timeout(30):
                await publishing


async def test_publish_async_ends_when_its_reader_does(master: Master) -> None:
    pixels = np.zeros((1080, 1920, 3), np.uint8)
    async with NodeHandle("camera", master=master.address, transports=TCP) as camera:
        publisher = await camera.advertise("image", LargeImage, qos=BLOCK)
        async with NodeHandle("viewer", master=master.address, transports=TCP) as viewer:
            await viewer.subscribe("image", LargeImage, qos=BLOCK)
            await publisher.wait_for_subscribers(1, timeout=30)

            async def film() -> None:
                while True:
                    await publisher.publish_async(full_hd(pixels))

            filming = asyncio.create_task(film())
            await until(lambda: publisher.statistics.published > 1)
        await until(lambda: publisher.subscriber_count == 0)
        # Without readers it runs on; closed, it says so.
        await until(lambda: publisher.statistics.published > 20)
    with pytest.raises(HandleClosed):
        await filming


async def test_malformed_large_messages_are_counted(master: Master) -> None:
    got: list[object] = []
    async with (
        NodeHandle("camera", master=master.address, transports=TCP) as camera,
        NodeHandle("viewer", master=master.address, transports=TCP) as viewer,
    ):
        await viewer.subscribe("image", LargeImage, got.append)
        publisher = await camera.advertise("image", LargeImage)
        await publisher.wait_for_subscribers(1, timeout=30)
        publisher.publish_bytes(b"\xff" * 100_000)
        publisher.publish_bytes(b"\x0a\xff")
        publisher.publish(LargeImage(*image(1)))
        await until(lambda: got)
        assert viewer.dropped_messages.counts["unparsable"] == 2

"""simple_ros itself as it is measured: ``python -m simple_ros.benchmark.ours JOB``.

Options: ``transport`` (``tcp``, ``unix`` or any other that a node knows), ``face`` (``blocking``), ``loop``
(``uvloop``), ``busy`` (busy polling), ``pixels`` (``inside``: large messages as plain protobuf objects).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from simple_ros.benchmark.payloads import image_fields, image_maker, twist_maker
from simple_ros.benchmark.program import ready, run_program
from simple_ros.benchmark.sink import Sink
from simple_ros.benchmark.source import drive, drive_async, until_end
from simple_ros.benchmark.workloads import Job
from simple_ros.net.loop import new_loop

__all__: list[str] = []

_TOPIC = "bench"
_LARGE_DEPTH = 8
_DEPTH = 1000
_BLOCKING_DEPTH = 10_000
_LIMIT_S = 20.0


def receive(job: Job, sink: Sink) -> Any:
    """A node with a subscription."""
    if job.options.get("face") == "blocking":
        return _blocking_receive(job, sink)
    return _receive(job, sink)


def send(job: Job) -> Any:
    """A node with a publisher."""
    if job.options.get("face") == "blocking":
        return _blocking_send(job)
    return _send(job)


async def _receive(job: Job, sink: Sink) -> None:
    from simple_ros.aio import NodeHandle

    async with NodeHandle(f"sink{job.index}", **_how(job)) as node:
        await node.subscribe(_TOPIC, _message_class(job), sink.message)
        ready()
        await node.spin()


async def _send(job: Job) -> None:
    from simple_ros.aio import NodeHandle
    from simple_ros.qos import DEFAULT

    depth = _LARGE_DEPTH if job.workload.size_bytes else _DEPTH
    async with NodeHandle("source", **_how(job)) as node:
        qos = DEFAULT.replace(overflow="block", depth=depth)
        publisher = await node.advertise(_TOPIC, _message_class(job), qos=qos)
        await publisher.wait_for_subscribers(job.workload.receivers, timeout=_LIMIT_S)

        async def publish(message: Any) -> None:
            publisher.publish(message)

        is_timed_small = job.workload.rate_hz and not job.workload.size_bytes
        put = publish if is_timed_small else publisher.publish_async
        await drive_async(job.workload, _maker(job), put)
        await publisher.flush(_LIMIT_S)
        await until_end()


def _blocking_receive(job: Job, sink: Sink) -> None:
    from simple_ros import NodeHandle
    from simple_ros.qos import DEFAULT

    depth = _LARGE_DEPTH if job.workload.size_bytes else _BLOCKING_DEPTH
    node = NodeHandle(f"sink{job.index}", **_how(job))
    qos = DEFAULT.replace(overflow="block", depth=depth)
    node.subscribe(_TOPIC, _message_class(job), sink.message, qos=qos)
    ready()
    node.spin()


def _blocking_send(job: Job) -> None:
    from simple_ros import NodeHandle
    from simple_ros.qos import DEFAULT

    depth = _LARGE_DEPTH if job.workload.size_bytes else _DEPTH
    node = NodeHandle("source", **_how(job))
    qos = DEFAULT.replace(overflow="block", depth=depth)
    publisher = node.advertise(_TOPIC, _message_class(job), qos=qos)
    publisher.wait_for_subscribers(job.workload.receivers, timeout=_LIMIT_S)
    drive(job.workload, _maker(job), publisher.publish)
    publisher.flush(_LIMIT_S)


def _how(job: Job) -> dict[str, Any]:
    transport = job.options.get("transport", "")
    # TCP stays in the list: whatever else a node knows, it may need it to be reached at all.
    names = [transport, "tcp"] if transport not in ("", "tcp") else [transport]
    how: dict[str, Any] = {"master": job.services["master"]}
    if transport:
        how["transports"] = names
    if job.options.get("busy"):
        how["busy_poll"] = True
    return how


def _message_class(job: Job) -> Any:
    if job.workload.shape == "twist":
        from simple_ros.msg.geometry_msgs import Twist

        return Twist
    from simple_ros.msg.sensor_msgs import Image

    if job.options.get("pixels") == "inside":
        return Image
    from simple_ros.large import large

    return large(Image)


def _maker(job: Job) -> Callable[[int], Any]:
    if job.workload.shape == "twist":
        return twist_maker(job.workload)
    if job.options.get("pixels") == "inside":
        return image_maker(job.workload)
    fields, large_class = image_fields(job.workload), _message_class(job)
    pixels = bytearray(job.workload.size_bytes)
    return lambda number: large_class(fields(number), pixels)


if __name__ == "__main__":
    run_program(receive, send, new_loop=new_loop)

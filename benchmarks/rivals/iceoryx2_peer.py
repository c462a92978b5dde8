"""iceoryx2: shared memory, blocking when the subscriber is behind, an event for each message.

Options: ``form`` (``raw``).
"""

import ctypes

import iceoryx2 as iox2
import lean  # noqa: F401

from simple_ros.benchmark.payloads import encoder, raw_maker
from simple_ros.benchmark.program import ready, run_program
from simple_ros.benchmark.source import drive

SMALL_DEPTH = 1000
LARGE_DEPTH = 8
HEAD_ROOM = 1024


def _services(job):
    iox2.set_log_level(iox2.LogLevel.Error)
    node = iox2.NodeBuilder.new().create(iox2.ServiceType.Ipc)
    name = iox2.ServiceName.new(f"bench/{job.services['iceoryx2']}/{job.workload.name}")
    topic = (
        node.service_builder(name)
        .publish_subscribe(iox2.Slice[ctypes.c_uint8])
        .enable_safe_overflow(False)
        .subscriber_max_buffer_size(LARGE_DEPTH if job.workload.size_bytes else SMALL_DEPTH)
        .max_subscribers(16)
        .max_nodes(32)
        .open_or_create()
    )
    event = node.service_builder(name).event().max_listeners(16).max_nodes(32).open_or_create()
    return node, topic, event


def receive(job, sink):
    _node, topic, event = _services(job)
    subscriber = topic.subscriber_builder().create()
    listener = event.listener_builder().create()
    is_raw = job.options.get("form") == "raw"
    take = sink.raw if is_raw else sink.parser()
    ready()
    while True:
        while (sample := subscriber.receive()) is not None:
            payload = sample.payload()
            take(payload.as_memory_view() if hasattr(payload, "as_memory_view") else payload)
            sample.delete()
        listener.timed_wait(iox2.Duration.from_millis(100))


def send(job):
    _node, topic, event = _services(job)
    size = max(job.workload.size_bytes, 64) + HEAD_ROOM
    publisher = (
        topic.publisher_builder()
        .initial_max_slice_len(size)
        .backpressure_strategy(iox2.BackpressureStrategy.RetryUntilDelivered)
        .create()
    )
    notify = event.notifier_builder().create().notify
    make = raw_maker(job.workload) if job.options.get("form") == "raw" else encoder(job.workload)

    def put(data):
        sample = publisher.loan_slice_uninit(len(data))
        ctypes.memmove(sample.payload_ptr, _address(data), len(data))
        sample.assume_init().send()
        notify()

    drive(job.workload, make, put)


def _address(data):
    if isinstance(data, bytes):
        return data
    return (ctypes.c_char * len(data)).from_buffer(data)


run_program(receive, send)

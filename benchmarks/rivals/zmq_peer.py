"""ZeroMQ: PUB and SUB with no high-water mark, so that nothing is dropped; large raw data is not copied.

Options: ``transport`` (``tcp`` or ``ipc``), ``form`` (``raw``).
"""

import os

import lean  # noqa: F401
import zmq

from simple_ros.benchmark.payloads import HEAD, encoder, raw_maker
from simple_ros.benchmark.program import ready, run_program
from simple_ros.benchmark.source import drive


def _socket(kind):
    socket = zmq.Context.instance().socket(kind)
    socket.setsockopt(zmq.SNDHWM, 0)
    socket.setsockopt(zmq.RCVHWM, 0)
    return socket


def receive(job, sink):
    sub = _socket(zmq.SUB)
    sub.setsockopt(zmq.SUBSCRIBE, b"")
    if job.options["transport"] == "ipc":
        at = f"ipc://@simple_ros_bench_{os.getpid()}"
        sub.bind(at)
    else:
        at = f"tcp://127.0.0.1:{sub.bind_to_random_port('tcp://127.0.0.1')}"
    ready(at)
    if job.options.get("form") == "raw":
        while True:
            head, data = sub.recv_multipart(copy=False)
            sink.pixels(*HEAD.unpack(head.buffer), data.buffer)
    take, recv = sink.parser(), sub.recv
    if job.workload.size_bytes:
        while True:
            take(recv(copy=False).buffer)
    while True:
        take(recv())


def send(job):
    pub = _socket(zmq.XPUB)
    pub.setsockopt(zmq.XPUB_VERBOSE, 1)  # tells each subscription, also one it knows
    for at in job.at:
        pub.connect(at)
    for _ in job.at:
        pub.recv()  # a subscription
    if job.options.get("form") == "raw":
        make, pixels = raw_maker(job.workload), bytes(job.workload.size_bytes)
        drive(
            job.workload,
            lambda number: [bytes(make(number)[: HEAD.size]), pixels],
            lambda parts: pub.send_multipart(parts, copy=False),
        )
        return
    if job.workload.size_bytes:
        drive(job.workload, encoder(job.workload), lambda data: pub.send(data, copy=False))
        return
    drive(job.workload, encoder(job.workload), pub.send)


run_program(receive, send)

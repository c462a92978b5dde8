"""Zenoh: peers that are connected directly, reliable, blocking when there is congestion.

Options: ``form`` (``raw``); ``memory`` (``auto``: Zenoh itself moves what is large through shared memory;
``shared``: raw bytes are written into shared buffers). Without it, everything goes by TCP.
"""

import json
import socket
import threading

import lean  # noqa: F401
import zenoh

from simple_ros.benchmark.payloads import encoder, raw_maker
from simple_ros.benchmark.program import ready, run_program
from simple_ros.benchmark.source import drive

KEY = "bench"
SHARED_BUFFERS = 8


def _session(job, role, ports):
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5(
        "transport/shared_memory/enabled", "true" if "memory" in job.options else "false"
    )
    endpoints = [f"tcp/127.0.0.1:{port}" for port in ports]
    config.insert_json5(f"{role}/endpoints", json.dumps(endpoints))
    return zenoh.open(config)


def _free_port():
    with socket.create_server(("127.0.0.1", 0)) as listening:
        return listening.getsockname()[1]


def receive(job, sink):
    port = _free_port()
    session = _session(job, "listen", [port])
    take = sink.raw if job.options.get("form") == "raw" else sink.parser()
    session.declare_subscriber(KEY, lambda sample: take(sample.payload.to_bytes()))
    ready(port)
    threading.Event().wait()


def send(job):
    session = _session(job, "connect", job.at)
    publisher = session.declare_publisher(
        KEY,
        congestion_control=zenoh.CongestionControl.BLOCK,
        reliability=zenoh.Reliability.RELIABLE,
    )
    make = raw_maker if job.options.get("form") == "raw" else encoder
    put = _shared_put(job, publisher) if job.options.get("memory") == "shared" else publisher.put
    drive(job.workload, make(job.workload), put)


def _shared_put(job, publisher):
    from zenoh import shm

    size = job.workload.size_bytes
    provider = shm.ShmProvider.default_backend(size * SHARED_BUFFERS)
    policy = shm.BlockOn(shm.GarbageCollect())

    def put(data):
        buffer = provider.alloc(size, policy)
        buffer[0:size] = data
        publisher.put(buffer)

    return put


run_program(receive, send)

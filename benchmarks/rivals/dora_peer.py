"""dora-rs: a dataflow of two dynamic nodes for each run, started by the receiver; Arrow around protobuf."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import dora
import lean  # noqa: F401

from simple_ros.benchmark.payloads import encoder
from simple_ros.benchmark.program import ready, run_program
from simple_ros.benchmark.source import drive

FLOW = """
nodes:
  - id: source{number}
    path: dynamic
    outputs: [bench]
  - id: sink{number}
    path: dynamic
    inputs:
      bench: {{source: source{number}/bench, queue_size: {queue}, queue_policy: {policy}}}
"""
SMALL_QUEUE = 1_000_000
LARGE_QUEUE = 1000


def receive(job, sink):
    number = os.getpid()
    queue = LARGE_QUEUE if job.workload.size_bytes else SMALL_QUEUE
    with tempfile.TemporaryDirectory() as directory:
        flow = Path(directory) / "flow.yml"
        # Back-pressure costs latency, so it is on only where messages go flat out.
        policy = "drop_oldest" if job.workload.rate_hz else "backpressure"
        flow.write_text(FLOW.format(number=number, queue=queue, policy=policy))
        subprocess.run(
            [str(Path(sys.executable).parent / "dora"), "start", str(flow), "--detach"],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    node = dora.Node(f"sink{number}")
    take = sink.parser()
    ready(number)
    while (event := node.next()) is not None:
        if event["type"] == "INPUT":
            take(memoryview(event["value"].buffers()[1]))


def send(job):
    node = dora.Node(f"source{job.at[0]}")
    drive(job.workload, encoder(job.workload), lambda data: node.send_output("bench", data))


run_program(receive, send)

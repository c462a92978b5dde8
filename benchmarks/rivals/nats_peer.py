"""NATS: one server, the asyncio client, no limit on what waits."""

import asyncio

import lean  # noqa: F401
import nats

from simple_ros.benchmark.payloads import encoder
from simple_ros.benchmark.program import ready, run_program
from simple_ros.benchmark.source import drive_async, until_end

SUBJECT = "bench"
PENDING_BYTES = 1 << 30


async def receive(job, sink):
    client = await nats.connect(job.services["nats"])
    parse = sink.parser()

    async def take(message):
        parse(message.data)

    await client.subscribe(
        SUBJECT, cb=take, pending_msgs_limit=10**9, pending_bytes_limit=PENDING_BYTES
    )
    await client.flush()
    ready()
    await asyncio.Event().wait()


async def send(job):
    client = await nats.connect(job.services["nats"])

    async def put(data):
        await client.publish(SUBJECT, data)

    await drive_async(job.workload, encoder(job.workload), put)
    await client.flush(30)
    await until_end()


run_program(receive, send)

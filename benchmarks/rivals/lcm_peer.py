"""LCM: UDP multicast that stays on this host. It has no flow control: ``max_hz`` keeps it from losing."""

import time

import lcm
import lean  # noqa: F401

from simple_ros.benchmark.payloads import encoder
from simple_ros.benchmark.program import ready, run_program
from simple_ros.benchmark.source import drive

CHANNEL = "bench"


def _lcm(job):
    return lcm.LCM(f"udpm://239.255.76.67:{job.services['lcm']}?ttl=0&recv_buf_size=16777216")


def receive(job, sink):
    link, take = _lcm(job), sink.parser()
    subscription = link.subscribe(CHANNEL, lambda _, data: take(data))
    subscription.set_queue_capacity(0)
    ready()
    while True:
        link.handle()


def send(job):
    link = _lcm(job)
    max_hz = float(job.options.get("max_hz", 0))
    if not max_hz or job.workload.rate_hz:
        drive(job.workload, encoder(job.workload), lambda data: link.publish(CHANNEL, data))
        return
    period, due, clock = 1 / max_hz, time.perf_counter(), time.perf_counter

    def put(data):
        nonlocal due
        while clock() < due:
            pass
        due = max(due, clock() - 10 * period) + period
        link.publish(CHANNEL, data)

    drive(job.workload, encoder(job.workload), put)


run_program(receive, send)

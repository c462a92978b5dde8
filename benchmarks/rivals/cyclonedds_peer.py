"""Cyclone DDS: reliable, keep all, protobuf inside a sequence of octets, taken by a listener."""

import os
import threading
from dataclasses import dataclass

import lean  # noqa: F401

os.environ.setdefault(
    "CYCLONEDDS_URI",
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/>"
    "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery>"
    "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
    "<Peers><Peer address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>",
)

from cyclonedds.core import Listener
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import sequence, uint8
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from simple_ros.benchmark.payloads import encoder
from simple_ros.benchmark.program import ready, run_program
from simple_ros.benchmark.source import drive

TAKEN_AT_ONCE = 256


@dataclass
class Bytes(IdlStruct, typename="bench.Bytes"):
    data: sequence[uint8]


QOS = Qos(Policy.Reliability.Reliable(duration(seconds=30)), Policy.History.KeepAll)


def receive(job, sink):
    parse = sink.parser()

    class Take(Listener):
        def on_data_available(self, reader):
            while samples := reader.take(N=TAKEN_AT_ONCE):
                for sample in samples:
                    if isinstance(sample, Bytes):
                        parse(bytes(sample.data))

    participant = DomainParticipant(int(job.services["dds"]))
    topic = Topic(participant, "bench", Bytes, qos=QOS)
    reader = DataReader(participant, topic, qos=QOS, listener=Take())
    ready()
    threading.Event().wait()
    del reader


def send(job):
    participant = DomainParticipant(int(job.services["dds"]))
    writer = DataWriter(participant, Topic(participant, "bench", Bytes, qos=QOS), qos=QOS)
    encode = encoder(job.workload)
    drive(job.workload, encode, lambda data: writer.write(Bytes(data)))


run_program(receive, send)

"""What the agent computes for a sample, with nobody to wait for: the part of its latency that is the code's."""

from __future__ import annotations

import time

from pico_tools import Place, Row, latency_rows

from simple_ros.msg.registry import MsgFactory
from simple_ros_firmware_bridge import cdr
from simple_ros_firmware_bridge.mapping import graph_type
from simple_ros_firmware_bridge.serial_agent import SerialAgent
from simple_ros_firmware_bridge.simulator.firmware import Firmware
from simple_ros_firmware_bridge.simulator.line import LineReader, frame
from simple_ros_firmware_bridge.xrce.agent import Agent
from simple_ros_firmware_bridge.xrce.events import Sample, WriterReady

_SIMULATED_S = 30.0
_STEP_S = 0.001


async def computing(_: Place) -> list[Row]:
    """CPU time from bytes to the answer, and from bytes to a serialised message, in simulated time."""
    serial = SerialAgent(Agent(lambda name: True, time.time_ns))
    firmware, reader = Firmware(), LineReader()
    classes = {}
    answers: list[float] = []
    samples: list[float] = []
    now = 0.0
    while now < _SIMULATED_S:
        now += _STEP_S
        firmware.run(now)
        for message in firmware.client.data_to_send():
            data = frame(message)
            begin = time.thread_time()
            serial.receive(data, now)
            answer = serial.data_to_send()
            answered = time.thread_time() - begin
            events = serial.agent.events()
            for event in events:
                if isinstance(event, Sample):
                    cdr.decode(event.data, classes[event.writer]).SerializeToString()
            took = time.thread_time() - begin
            for event in events:
                if isinstance(event, Sample):
                    samples.append(took)
                    answers.append(answered)
                elif isinstance(event, WriterReady):
                    name = graph_type(event.endpoint.type_name)
                    classes[event.endpoint.object_id] = MsgFactory.instance().get_class(name)
            for reply in reader.feed(answer):
                firmware.receive(reply, now)
    return [
        *latency_rows("CPU time from the last bytes of a sample to its ACKNACK", answers),
        *latency_rows("CPU time from the last bytes of a sample to its message", samples, 1),
    ]

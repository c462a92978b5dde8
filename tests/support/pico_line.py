"""A board and an agent on a line that loses messages, in simulated time: the same seed, the same run."""

from __future__ import annotations

import heapq
import itertools
import random
from dataclasses import dataclass

from simple_ros_firmware_bridge.simulator.client import BoardClient, Stage
from simple_ros_firmware_bridge.simulator.creation import Topic
from simple_ros_firmware_bridge.xrce.agent import Agent
from simple_ros_firmware_bridge.xrce.events import ReaderReady, Sample

RATES_HZ = {
    "joint_states": 100,
    "imu/data_raw": 50,
    "odom": 20,
    "tof": 10,
    "ultrasonic": 10,
    "lux": 5,
}
SIZES = {
    "joint_states": 220,
    "imu/data_raw": 320,
    "odom": 720,
    "tof": 44,
    "ultrasonic": 44,
    "lux": 36,
}
TYPES = {
    "joint_states": "sensor_msgs/JointState",
    "imu/data_raw": "sensor_msgs/Imu",
    "odom": "nav_msgs/Odometry",
    "tof": "sensor_msgs/Range",
    "ultrasonic": "sensor_msgs/Range",
    "lux": "sensor_msgs/Illuminance",
}


@dataclass
class Line:
    """How bad the line and how slow the board is.

    Attributes:
        delay_s: From one end to the other, with what the board needs to handle a message.
        loss: Share of whole messages that vanish, each way.
        chunk_errors: Share of chunks of 42 bytes with a flipped bit, which is noticed.
        jitter: Part of the delay that varies.
        command_hz: Samples down.
    """

    delay_s: float = 0.0005
    loss: float = 0.0
    chunk_errors: float = 0.0
    jitter: float = 0.2
    command_hz: float = 20.0


@dataclass
class Outcome:
    """What came of it."""

    published: int
    failed: int
    received: int
    duplicates: int
    sends_per_message: float
    answers: int
    commands: int
    wait_s: float
    questions: int


class Run:
    """One run in simulated time."""

    def __init__(self, line: Line, seed: int) -> None:
        self.line = line
        self.rng = random.Random(seed)
        topics = [Topic(1 + i, f"/{name}", TYPES[name]) for i, name in enumerate(RATES_HZ)]
        topics.append(Topic(9, "/cmd_vel", "geometry_msgs/Twist", is_published=False))
        self.client = BoardClient(topics)
        self.agent = Agent(lambda name: True, lambda: 0)
        self.now = 0.0
        self.clear = {"up": 0.0, "down": 0.0}
        self.counter = itertools.count()
        self.events: list[tuple[float, int, str, bytes]] = []
        self.due: list[float] = []
        self.readers: list[ReaderReady] = []
        self.received = 0
        self.commands = 0
        self.answers = 0
        self.is_clean = True

    def put(self, way: str, data: bytes) -> None:
        roll = self.rng.random()
        arrives = self.now + self.line.delay_s * (1 + self.line.jitter * self.rng.random())
        arrives = self.clear[way] = max(arrives, self.clear[way] + 1e-6)
        garbled = 1 - (1 - self.line.chunk_errors) ** ((len(data) + 8) / 42)
        if self.is_clean or roll >= self.line.loss + garbled:
            heapq.heappush(self.events, (arrives, next(self.counter), way, data))
        elif roll >= self.line.loss and way == "up":
            heapq.heappush(self.events, (arrives, next(self.counter), "garbled", data))

    def pump(self) -> None:
        for data in self.client.data_to_send():
            self.put("up", data)
        for data in self.agent.data_to_send():
            self.answers += 1
            self.put("down", data)
        for event in self.agent.events():
            self.received += isinstance(event, Sample)
            if isinstance(event, ReaderReady):
                self.readers.append(event)

    def publish_due(self) -> None:
        """As rclc's executor: every timer that is due once, what was missed is skipped."""
        for index, (name, rate) in enumerate(RATES_HZ.items()):
            if self.now < self.due[index] or self.client.is_blocked:
                continue
            period = 1 / rate
            self.client.publish(index, bytes(SIZES[name]), self.now)
            self.due[index] += period * max(1, -int((self.due[index] - self.now) // period))

    def command(self, at: float) -> float:
        if at > self.now:
            return at
        for reader in self.readers:
            self.agent.write(reader.endpoint.object_id, bytes(48), "cmd_vel", self.now)
        return at + 1 / self.line.command_hz

    def step(self, until: float) -> None:
        times = [until, *self.due]
        if self.client.is_blocked:
            times = [until]
        times += [
            t for t in (self.client.next_timeout(), self.agent.next_timeout()) if t is not None
        ]
        times += [self.events[0][0]] if self.events else []
        self.now = max(self.now, min(times))
        while self.events and self.events[0][0] <= self.now:
            _, _, way, data = heapq.heappop(self.events)
            if way == "up":
                self.agent.receive(data, self.now)
            elif way == "garbled":
                self.agent.line_damaged(data, self.now)
            else:
                self.client.receive(data, self.now)
        self.client.handle_timeout(self.now)
        self.agent.handle_timeout(self.now)
        self.commands += len(self.client.take_samples())

    def run(self, seconds: float) -> Outcome:
        while self.client.stage is not Stage.RUNNING or self.client.output.slots:
            self.step(self.now + 1)
            self.pump()
            assert self.now < 60, self.client.stage
        self.is_clean = False
        self.due = [self.now + 0.001 * i for i in range(len(RATES_HZ))]
        end, next_command = self.now + seconds, self.now
        messages, sends = self.client.output.messages, self.client.output.sends
        self.answers = self.received = 0
        while self.now < end:
            self.step(min(end, next_command))
            next_command = self.command(next_command)
            self.publish_due()
            self.pump()
        assert self.agent.session is not None
        source = self.agent.session.streams.inputs[0]
        output = self.client.output
        return Outcome(
            published=self.client.counters.published,
            failed=self.client.counters.failed,
            received=self.received,
            duplicates=source.counters.duplicates,
            sends_per_message=(output.sends - sends) / max(1, output.messages - messages),
            answers=self.answers,
            commands=self.commands,
            wait_s=source.patience.wait_s,
            questions=source.counters.asked,
        )

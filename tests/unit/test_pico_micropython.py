"""The MicroPython firmware's logic, imported into CPython: frames, messages, wheels, sensors, the client."""

from __future__ import annotations

import builtins
import importlib
import math
import random
import struct
import sys
import types
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.nav_msgs import Odometry
from simple_ros.msg.sensor_msgs import Illuminance, Imu, JointState, Range
from simple_ros_firmware_bridge import cdr
from simple_ros_firmware_bridge.mecanum import BodySpeed, Mecanum, Pose, integrated
from simple_ros_firmware_bridge.simulator.line import LineReader, crc, frame
from simple_ros_firmware_bridge.xrce.agent import Agent
from simple_ros_firmware_bridge.xrce.events import ReaderReady, Sample, SessionOpened, WriterReady

FOLDER = Path(__file__).parents[2] / "firmware_bridge" / "micropython"
WALL_NS = 1_700_000_000_250_000_000


def load(*names: str) -> list[Any]:
    """Modules of the firmware, which are nobody else's afterwards: their names are common ones."""
    stub: Any = types.ModuleType("micropython")
    stub.native = stub.viper = lambda function: function
    before = set(sys.modules)
    sys.modules["micropython"] = stub
    sys.path.insert(0, str(FOLDER))
    kinds = ("ptr8", "ptr16", "ptr32")
    for kind in kinds:
        setattr(builtins, kind, bytearray)
    try:
        return [importlib.import_module(name) for name in names]
    finally:
        for kind in kinds:
            delattr(builtins, kind)
        sys.path.remove(str(FOLDER))
        for name in set(sys.modules) - before:
            if str(FOLDER) in str(getattr(sys.modules[name], "__file__", None) or FOLDER):
                del sys.modules[name]


framing, messages, drive, sensors, clock, creation, xrce, app, config = load(
    "framing", "messages", "drive", "sensors", "clock", "creation", "xrce", "app", "config"
)


# -- frames ----------------------------------------------------------------------------------------


def encoded(payload: bytes) -> bytes:
    writer = framing.FrameWriter()
    return bytes(writer.frame[: writer.encode(payload, len(payload))])


def decoded(stream: bytes, cuts: list[int]) -> list[bytes]:
    reader = framing.FrameReader()
    found = []
    at = 0
    for cut in [*cuts, len(stream)]:
        chunk = stream[at : at + cut]
        at += cut
        reader.feed(chunk, len(chunk))
        while size := reader.take():
            found.append(bytes(reader.message[:size]))
    return found


def test_the_checksum_is_arc() -> None:
    assert encoded(b"123456789")[-2:] == bytes((0x3D, 0xBB))
    assert crc(b"123456789") == 0xBB3D


@given(st.binary(min_size=1, max_size=512))
def test_frames_are_those_of_the_other_board(payload: bytes) -> None:
    assert encoded(payload) == frame(payload)
    assert LineReader().feed(encoded(payload)) == [payload]


@given(
    st.lists(st.binary(min_size=1, max_size=60), max_size=5),
    st.lists(st.integers(1, 30), max_size=20),
    st.binary(max_size=20),
)
def test_any_chunks_and_text_between(payloads: list[bytes], cuts: list[int], noise: bytes) -> None:
    noise = noise.replace(b"\x7e", b"")
    stream = b"".join(noise + frame(payload) for payload in payloads)
    assert decoded(stream, cuts) == payloads


def test_what_is_damaged_cut_or_too_long_is_dropped_and_the_next_frame_found() -> None:
    good = frame(b"good")
    flipped = bytearray(good)
    flipped[6] ^= 4
    too_long = b"\x7e\0\0\xff\xff" + bytes(40)
    for bad in (bytes(flipped), good[:7], too_long, frame(b"not for us", destination=1)):
        assert decoded(bad + good, [5]) == [b"good"]


def test_garbage_raises_nothing() -> None:
    rng = random.Random(3)
    garbage = rng.randbytes(100_000)
    assert decoded(garbage + bytes(520) + frame(b"after"), [64] * 1700)[-1] == b"after"


# -- messages --------------------------------------------------------------------------------------


def test_messages_are_what_the_bridge_reads() -> None:
    now = clock.Clock()
    now.add(1_250_000)
    joints = messages.JointState(["left", "right"])
    joints.fill([1.5, -2.5], [3.0, 4.0])
    joints.stamp(now)
    read: Any = cdr.decode(bytes(joints.data), JointState)
    assert list(read.name) == ["left", "right"]
    assert (list(read.position), list(read.velocity)) == ([1.5, -2.5], [3.0, 4.0])
    assert read.header.stamp.ToNanoseconds() == 1_250_000_000

    imu = messages.Imu("imu_link", 0.25, 0.5)
    imu.fill([1, 2, 3, 4, 5, 6])
    read = cdr.decode(bytes(imu.data), Imu)
    assert (read.angular_velocity.x, read.linear_acceleration.z) == (1, 6)
    assert read.orientation_covariance[0] == -1
    assert list(read.angular_velocity_covariance)[::4] == [0.25] * 3
    assert list(read.linear_acceleration_covariance)[::4] == [0.5] * 3

    odometry = messages.Odometry("odom", "base_link", range(1, 7), range(11, 17))
    odometry.fill_pose(1, 2, 0.6, 0.8)
    odometry.fill_twist(3, 4, 5)
    read = cdr.decode(bytes(odometry.data), Odometry)
    assert (read.header.frame_id, read.child_frame_id) == ("odom", "base_link")
    assert (read.pose.pose.position.y, read.pose.pose.orientation.z) == (2, 0.6)
    assert (read.twist.twist.linear.y, read.twist.twist.angular.z) == (4, 5)
    assert list(read.pose.covariance)[::7] == [1, 2, 3, 4, 5, 6]
    assert list(read.twist.covariance)[::7] == [11, 12, 13, 14, 15, 16]

    tof = messages.Range("range_tof", True, 0.5, 0.25, 2)
    tof.fill(math.inf)
    read = cdr.decode(bytes(tof.data), Range)
    assert (read.radiation_type, read.range, read.max_range) == (Range.INFRARED, math.inf, 2)

    light = messages.Illuminance("range_tof")
    light.fill(321.5)
    assert cdr.decode(bytes(light.data), Illuminance).illuminance == 321.5

    twist = Twist()
    twist.linear.x, twist.linear.y, twist.angular.z = 1, 2, 3
    assert messages.Twist.read(b"...." + cdr.encode(twist), 4) == (1, 2, 3)


# -- wheels ----------------------------------------------------------------------------------------


class Wheels:
    """Motors that do what they are told, after a while."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.drive = drive.Drive(config, self.said.append)
        self.counts = [0.0] * 4
        self.speeds = [0.0] * 4
        self.now = 0
        self.encoder_signs = [1, 1, 1, 1]

    def run(self, ms: int) -> None:
        for _ in range(ms // 10):
            self.now += 10
            for i in range(4):
                end = self.drive.duties[i] * 18
                self.speeds[i] += (end - self.speeds[i]) * 0.2
                turned = self.speeds[i] * 0.01 / (2 * math.pi) * config.COUNTS_PER_TURN
                self.counts[i] += turned * self.encoder_signs[i]
            self.drive.update([int(count) for count in self.counts], 10_000, self.now)


def test_wheels_reach_the_speeds_of_the_kinematics() -> None:
    robot = Wheels()
    body = BodySpeed(0.1, -0.05, 0.4)
    for _ in range(20):
        robot.drive.command(*body, robot.now)
        robot.run(100)
    wanted = Mecanum(config.WHEEL_RADIUS_M, config.LEVER_M).wheels(body)
    assert list(robot.drive.speeds) == pytest.approx(list(wanted), abs=0.15)
    assert (robot.drive.vx, robot.drive.wz) == pytest.approx((0.1, 0.4), abs=0.01)


def test_odometry_is_what_integration_says() -> None:
    it = drive.Drive(config, print)
    mecanum = Mecanum(config.WHEEL_RADIUS_M, config.LEVER_M)
    body = BodySpeed(0.3, 0.1, 0.5)
    pose = Pose()
    turns = [speed / (2 * math.pi) * config.COUNTS_PER_TURN for speed in mecanum.wheels(body)]
    for step in range(1, 501):
        pose = integrated(pose, body, 0.01)
        it.update([round(turn * step * 0.01) for turn in turns], 10_000, step * 10)
    assert (it.x.value, it.y.value) == pytest.approx((pose.x, pose.y), abs=0.002)
    assert it.yaw == pytest.approx(2.5, abs=0.002)


def test_an_old_command_stops_it_and_nonsense_is_no_command() -> None:
    robot = Wheels()
    robot.drive.command(0.4, 0, 0, 0)
    robot.run(450)
    robot.drive.command(math.nan, 0, 0, robot.now)
    assert robot.drive.vx > 0.2
    robot.run(1000)
    assert list(robot.drive.duties) == [0, 0, 0, 0]
    assert robot.drive.vx == pytest.approx(0, abs=0.02)


def test_too_fast_is_slower_the_same_way() -> None:
    robot = Wheels()
    robot.drive.command(100, 50, 0, 0)
    robot.run(300)
    assert robot.drive.vy / robot.drive.vx == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("sign", [0, -1])
def test_a_wheel_whose_encoder_does_not_follow_is_switched_off(sign: int) -> None:
    robot = Wheels()
    robot.encoder_signs[1] = sign
    for _ in range(40):
        robot.drive.command(0.2, 0, 0, robot.now)
        robot.run(100)
    assert robot.drive.duties[1] == 0
    assert robot.drive.duties[0] > 0
    (said,) = robot.said
    assert "front_right" in said
    robot.encoder_signs[1] = 1
    robot.drive.stop()
    robot.run(1000)
    robot.drive.command(0.2, 0, 0, robot.now)
    robot.run(200)
    assert robot.drive.duties[1] > 0


# -- sensors ---------------------------------------------------------------------------------------


class Bus:
    """I2C with chips that are tables of registers."""

    def __init__(self, **registers: int) -> None:
        self.registers: dict[int, int] = {}
        self.written: list[tuple[int, int]] = []

    def readfrom_mem_into(
        self, address: int, register: int, into: bytearray, *, addrsize: int = 8
    ) -> None:
        for i in range(len(into)):
            into[i] = self.registers.get(register + i, 0)

    def writeto_mem(self, address: int, register: int, data: bytes, *, addrsize: int = 8) -> None:
        self.written += [(register + i, byte) for i, byte in enumerate(data)]
        for i, byte in enumerate(data):
            self.registers[register + i] = byte


def test_mpu6050_units_axes_and_rest() -> None:
    bus = Bus()
    bus.registers[0x75] = 0x68

    def put(*values: int) -> None:
        bus.registers.update(enumerate(struct.pack(">7h", *values), 0x3B))

    chip = sensors.Mpu6050(bus, ((1, -1), (0, 1), (2, 1)))
    assert chip.name == "MPU6050"
    assert (0x6B, 1) in bus.written
    values = [0.0] * 6
    put(8192, 0, -8192, 0, 655, 0, 6550)
    chip.read(values, False)
    assert values[3:] == pytest.approx([0, 9.80665, -9.80665])
    assert values[:3] == pytest.approx([0, math.radians(10), math.radians(100)], abs=0.01)
    put(0, 0, 8192, 0, 20, -30, 40)
    for _ in range(150):
        chip.read(values, True)
    assert values[:3] == pytest.approx([0, 0, 0], abs=1e-6)
    for _ in range(150):
        put(0, 0, 8192, 0, 20, -30, 640)
        chip.read(values, False)
    assert values[2] == pytest.approx(math.radians(600 / 65.536))


def test_vl6180x_measures_distance_and_light_in_turn() -> None:
    bus = Bus()
    bus.registers.update({0x0000: 0xB4, 0x0016: 1})
    chip = sensors.Vl6180x(bus)
    assert (0x0207, 0x01) in bus.written
    assert (0x0016, 0) in bus.written
    assert bus.written[-1] == (0x0018, 1)
    chip.poll()
    assert chip.take_distance() is None
    bus.registers.update({0x004F: 4, 0x004D: 1, 0x0062: 123})
    chip.poll()
    assert chip.take_distance() == 0.123
    assert chip.take_distance() is None
    assert bus.written[-1] == (0x0038, 1)
    bus.registers.update({0x004F: 4 << 3, 0x0050: 0x03, 0x0051: 0xE8})
    chip.poll()
    assert chip.take_light() == pytest.approx(320)
    bus.registers.update({0x004F: 4, 0x004D: 0x71})
    chip.poll()
    assert chip.take_distance() == math.inf


def test_another_chip_at_its_address_is_told() -> None:
    with pytest.raises(OSError, match="no VL6180X"):
        sensors.Vl6180x(Bus())


# -- the client and the agent ----------------------------------------------------------------------


class Still:
    """Hardware that does nothing."""

    def __init__(self) -> None:
        self.duties = [0.0] * 4

    def identity(self) -> bytes:
        return b"board"

    def update(self, now: int) -> None:
        pass

    def read_wheels(self, counts: Any) -> None:
        pass

    def drive(self, duties: Any) -> None:
        self.duties = list(duties)

    def stop(self) -> None:
        self.duties = [0.0] * 4

    def imu(self, values: Any) -> bool:
        return True

    def tof(self) -> float | None:
        return None

    def light(self) -> float | None:
        return 5.0

    def sonar(self) -> float | None:
        return 1.0

    def led(self, is_on: bool) -> None:
        self.is_lit = is_on


class Pair:
    """The firmware and an agent in simulated time, on a line that loses whole messages."""

    def __init__(self, loss: float = 0.0) -> None:
        self.rng = random.Random(7)
        self.loss = loss
        self.agent: Agent | None = self.fresh_agent()
        self.hardware = Still()
        self.clock = clock.Clock()
        self.said: list[str] = []
        self.events: list[Any] = []
        self.up: list[bytes] = []
        self.sent = 0
        self.app = app.App(config, self.hardware, self.clock, self.send, self.said.append)

    def fresh_agent(self, remembered: Any = None) -> Agent:
        return Agent(lambda name: True, lambda: WALL_NS, remembered=remembered)

    def send(self, buffer: Any, size: int) -> None:
        self.sent += 1
        if self.rng.random() >= self.loss:
            self.up.append(bytes(buffer[:size]))

    def run(self, ms: int) -> None:
        for _ in range(ms):
            self.clock.add(1000)
            self.app.run()
            up, self.up = self.up, []
            if self.agent is None:
                continue
            now = self.clock.ms() / 1000
            for message in up:
                self.agent.receive(message, now)
            self.agent.handle_timeout(now)
            for answer in self.agent.data_to_send():
                if self.rng.random() >= self.loss:
                    self.app.receive(bytearray(answer), len(answer))
            self.events += self.agent.events()

    def of(self, kind: type[Any]) -> list[Any]:
        return [event for event in self.events if isinstance(event, kind)]

    def command(self, vx: float) -> None:
        assert self.agent is not None
        (reader, *_) = self.of(ReaderReady)
        twist = Twist()
        twist.linear.x = vx
        data = cdr.encode(twist)
        self.agent.write(reader.endpoint.object_id, data, "cmd_vel", self.clock.ms() / 1000)


def test_every_topic_is_created_and_published_at_its_rate() -> None:
    pair = Pair()
    pair.run(500)
    written = {event.endpoint.topic: event.endpoint for event in pair.of(WriterReady)}
    assert set(written) == {"rt/" + name for name in config.RATES_HZ}
    assert [event.endpoint.topic for event in pair.of(ReaderReady)] == ["rt/cmd_vel"]
    pair.events.clear()
    pair.run(4000)
    counts = dict.fromkeys(config.RATES_HZ, 0)
    names = {endpoint.object_id: topic.removeprefix("rt/") for topic, endpoint in written.items()}
    for sample in pair.of(Sample):
        counts[names[sample.writer]] += 1
    expected = {name: rate * 4 for name, rate in config.RATES_HZ.items()}
    expected["sensors/range_tof"] = 0  # it has nothing to say
    assert counts == pytest.approx(expected, abs=1)
    assert pair.hardware.is_lit


def test_what_is_too_large_for_a_message_is_refused_at_the_start() -> None:
    changed: Any = types.SimpleNamespace(**vars(config) | {"RELIABLE": ()})
    with pytest.raises(
        ValueError, match="odom has 720 bytes, 496 are possible: name it in RELIABLE"
    ):
        app.App(changed, Still(), clock.Clock(), print, print)
    with pytest.raises(ValueError, match="513"):
        encoded(bytes(513))


def test_the_time_of_day_comes_from_the_bridge() -> None:
    pair = Pair()
    pair.run(500)
    assert pair.clock.stamp_s() == WALL_NS // 10**9
    assert pair.clock.stamp_ns() == pytest.approx(WALL_NS % 10**9, abs=500_000_000)


def test_commands_drive_and_their_end_stops() -> None:
    pair = Pair()
    pair.run(500)
    for _ in range(5):
        pair.command(0.1)
        pair.run(50)
    assert min(pair.hardware.duties) > 0
    pair.agent = None
    pair.run(600)
    assert pair.hardware.duties == [0] * 4


def test_loss_costs_no_reliable_sample() -> None:
    pair = Pair(loss=0.05)
    pair.run(5000)
    assert pair.app.client.is_connected
    odometry = next(event for event in pair.of(WriterReady) if event.endpoint.topic == "rt/odom")
    pair.events.clear()
    pair.run(10_000)
    samples = [it for it in pair.of(Sample) if it.writer == odometry.endpoint.object_id]
    assert len(samples) == pytest.approx(200, abs=12)
    assert pair.app.client.output.resent > 0
    assert pair.app.client.sessions == 1


def test_an_agent_that_comes_back_with_its_memory_goes_unnoticed() -> None:
    pair = Pair()
    pair.run(1000)
    assert pair.agent is not None
    remembered = pair.agent.remembered()
    pair.agent = None
    pair.run(700)
    pair.agent = pair.fresh_agent(remembered)
    pair.events.clear()
    pair.run(1000)
    assert pair.app.client.sessions == 1
    assert len(pair.of(Sample)) > 50
    pair.command(0.1)
    pair.run(50)
    assert min(pair.hardware.duties) > 0


def test_after_a_long_absence_too() -> None:
    pair = Pair()
    pair.run(1000)
    assert pair.agent is not None
    remembered = pair.agent.remembered()
    pair.agent = None
    pair.run(60_000)
    assert not pair.app.client.is_connected
    sent = pair.sent
    pair.run(10_000)
    assert 30 < pair.sent - sent < 50  # it asks four times a second, and is silent otherwise
    pair.agent = pair.fresh_agent(remembered)
    pair.events.clear()
    pair.run(1000)
    assert pair.app.client.sessions == 1
    assert len(pair.of(Sample)) > 50


def test_an_agent_without_memory_makes_it_begin_anew() -> None:
    pair = Pair()
    pair.run(1000)
    pair.agent = pair.fresh_agent()
    pair.events.clear()
    pair.run(2000)
    assert pair.app.client.sessions == 2
    assert len(pair.of(SessionOpened)) == 1
    assert len(pair.of(Sample)) > 50


def test_a_board_that_was_reset_is_the_same_to_the_agent() -> None:
    pair = Pair()
    pair.run(1000)
    again = Pair()
    again.agent = pair.agent
    again.run(1000)
    (opened,) = again.of(SessionOpened)
    assert opened.is_same
    assert len(again.of(Sample)) > 20


def test_a_type_the_bridge_does_not_know_is_told_and_the_rest_works() -> None:
    pair = Pair()
    pair.agent = Agent(lambda name: "Illuminance" not in name, lambda: WALL_NS)
    pair.run(2000)
    assert pair.app.client.is_connected
    assert any("sensors/illuminance" in text for text in pair.said)


def test_messages_of_any_content_raise_nothing() -> None:
    rng = random.Random(11)
    pair = Pair()
    pair.run(500)
    for _ in range(3000):
        body = bytearray(rng.randbytes(rng.randrange(60)))
        head = struct.pack("<BBH", 0x81, rng.choice((0, 1, 0x80)), rng.randrange(5))
        kind = bytes((rng.randrange(16), rng.choice((1, 3)), rng.randrange(60), 0))
        message = bytearray(head + kind + body)
        pair.app.receive(message, len(message))
    pair.run(5000)
    assert pair.app.client.is_connected

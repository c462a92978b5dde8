"""The Pico bridge on a pseudo terminal: latency, load, bad lines, restarts, the control loop.

    python benchmarks/pico.py [--seconds 60]

The board is simulated in this process; Master, bridge and controller are processes of their own. "lossy" runs
are also played in simulated time, where both speeds of boards can be compared exactly.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import itertools
import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import psutil

from simple_ros import aio
from simple_ros.msg.diagnostic_msgs import DiagnosticArray
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.registry import MsgFactory
from simple_ros.msg.sensor_msgs import JointState
from simple_ros_firmware_bridge.mecanum import BodySpeed
from simple_ros_firmware_bridge.simulator.firmware import Firmware
from simple_ros_firmware_bridge.simulator.pty_board import PtyBoard

TOPICS = {
    "joint_states": "sensor_msgs.JointState",
    "imu/data_raw": "sensor_msgs.Imu",
    "odom": "nav_msgs.Odometry",
    "sensors/range_tof": "sensor_msgs.Range",
    "sensors/range_ultrasonic": "sensor_msgs.Range",
    "sensors/illuminance": "sensor_msgs.Illuminance",
}


def percentile(values: list[float], share: float) -> float:
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def told(name: str, values: list[float]) -> None:
    print(
        f"  {name}: median {percentile(values, 0.5) * 1e3:.2f} ms, "
        f"p99 {percentile(values, 0.99) * 1e3:.2f} ms, worst {max(values) * 1e3:.2f} ms "
        f"({len(values)} samples)"
    )


_children: list[asyncio.subprocess.Process] = []


async def started(*words: str) -> asyncio.subprocess.Process:
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        *words,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    _children.append(process)
    return process


async def ended(process: asyncio.subprocess.Process) -> None:
    if process.returncode is None:
        process.terminate()
    await process.communicate()


async def until(condition: Callable[[], object], limit_s: float = 20) -> None:
    end = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("the bridge did not do what is measured")
        await asyncio.sleep(0.001)


def flipping(rng: random.Random) -> Callable[[bytes], bytes]:
    def spoil(data: bytes) -> bytes:
        out = bytearray(data)
        for start in range(0, len(out), 42):
            if rng.random() < 0.01:
                out[rng.randrange(start, min(start + 42, len(out)))] ^= 1 << rng.randrange(8)
        return bytes(out)

    return spoil


class Bench:
    def __init__(self, master: str, state: Path, seconds: float) -> None:
        self.master = master
        self.state = state
        self.seconds = seconds

    def bridge(self, board: PtyBoard, *words: str) -> tuple[str, ...]:
        port = ("--port", board.path, "--state", str(self.state), "--master", self.master)
        return ("simple_ros_firmware_bridge", *port, *words)

    async def clean(self) -> None:
        firmware = Firmware()
        async with PtyBoard(firmware) as board, aio.NodeHandle("l", master=self.master) as looker:
            ages: list[float] = []
            counts = dict.fromkeys(TOPICS, 0)

            def count(topic: str, message: object) -> None:
                counts[topic] += 1
                ages.append(time.time() - message.header.stamp.ToNanoseconds() / 1e9)  # type: ignore[attr-defined]

            for topic, name in TOPICS.items():
                kind = MsgFactory.instance().get_class(name)
                await looker.subscribe(topic, kind, lambda m, t=topic: count(t, m))
            inside: list[float] = []
            await looker.subscribe(
                "diagnostics",
                DiagnosticArray,
                lambda m: inside.extend(
                    float(item.value) / 1e3
                    for item in m.status[0].values
                    if item.key == "latency to topic, p99 (ms)"
                ),
            )
            process = await started(*self.bridge(board))
            await until(lambda: all(counts.values()))
            usage = psutil.Process(process.pid)
            spent = sum(usage.cpu_times()[:2])
            before, sent = sum(counts.values()), firmware.client.counters.published
            ages.clear()
            await asyncio.sleep(self.seconds)
            got, sent = sum(counts.values()) - before, firmware.client.counters.published - sent
            spent = sum(usage.cpu_times()[:2]) - spent
            print(f"clean line, {self.seconds:g} s")
            print(f"  {sent / self.seconds:.1f} samples/s sent, {sent - got} fewer on the topics")
            print(f"  {100 * spent / self.seconds:.1f} % of a core in the bridge")
            told("bridge alone, read to published, p99 of each second", inside[1:])
            told("board's stamp to subscriber's callback", ages)
            await ended(process)

    async def bad_cable(self, command_hz: float) -> None:
        spoil = flipping(random.Random(1))
        firmware = Firmware(key=b"bad!")
        async with (
            PtyBoard(firmware, spoil_up=spoil, spoil_down=spoil) as board,
            aio.NodeHandle("l", master=self.master) as pilot,
        ):
            process = await started(*self.bridge(board))
            commands = await pilot.advertise("cmd_vel", Twist)
            pilot.create_timer(1 / command_hz, lambda _: commands.publish(Twist()))
            await until(lambda: firmware.client.counters.published > 50)
            counters = firmware.client.counters
            before, failed, begin = counters.published, counters.failed, time.monotonic()
            await asyncio.sleep(min(20.0, self.seconds))
            best = 195 * (time.monotonic() - begin)
            print(f"1 % of 42-byte chunks with a flipped bit, cmd_vel at {command_hz:g} Hz")
            print(
                f"  {100 * (counters.published - before) / best:.1f} % of the best possible, "
                f"{counters.failed - failed} failed"
            )
            await ended(process)

    async def restart(self) -> None:
        firmware = Firmware(key=b"kill", gives_up=True)
        async with PtyBoard(firmware) as board, aio.NodeHandle("l", master=self.master) as looker:
            times: list[float] = []
            await looker.subscribe(
                "joint_states", JointState, lambda _: times.append(time.monotonic())
            )
            process = await started(*self.bridge(board))
            await until(lambda: len(times) > 50)
            process.kill()
            await process.communicate()
            seen = len(times)
            process = await started(*self.bridge(board))
            await until(lambda: len(times) > seen + 50)
            hole = max(later - earlier for earlier, later in itertools.pairwise(times))
            print("bridge killed with -9 and started at once")
            print(
                f"  hole {hole:.2f} s, the board began anew {firmware.client.counters.resets} times"
            )
            await ended(process)

    async def control(self) -> None:
        firmware = Firmware(key=b"ctrl")
        arrived = asyncio.Event()
        wanted = 0.0
        obey = firmware.robot.command

        def note(body: BodySpeed, now: float) -> None:
            obey(body, now)
            if (body.vx > 0) == (wanted > 0):
                arrived.set()

        firmware.robot.command = note  # type: ignore[method-assign]
        async with PtyBoard(firmware) as board, aio.NodeHandle("l", master=self.master) as pilot:
            bridge = await started(*self.bridge(board, "--remap", "cmd_vel:=hardware/cmd_vel"))
            loop = await started(
                "simple_ros.cli.main", "pico", "controller", "--master", self.master
            )
            commands = await pilot.advertise("cmd_vel", Twist)
            await commands.wait_for_subscribers(timeout=20)
            await asyncio.wait_for(arrived.wait(), 20)
            took: list[float] = []
            rng = random.Random(3)
            for number in range(400):
                await asyncio.sleep(0.02 + 0.01 * rng.random())
                wanted = 0.02 if number % 2 == 0 else 0.0
                arrived.clear()
                message = Twist()
                message.linear.x = wanted
                begin = time.monotonic()
                while (
                    not arrived.is_set()
                ):  # a command that came while the robot was down is forgotten
                    commands.publish(message)
                    with contextlib.suppress(TimeoutError):
                        await asyncio.wait_for(arrived.wait(), 0.1)
                took.append(time.monotonic() - begin)
            print("control loop at 100 Hz")
            told("cmd_vel to the motors of the board, through the controller", took)
            await ended(loop)
            await ended(bridge)


def simulated() -> None:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
    from support.pico_line import Line, Run

    print("5 % of messages lost each way, simulated time, 20 s")
    for name, delay_s in (("board", 0.0005), ("board 20 times slower", 0.01)):
        for command_hz in (20, 100):
            lines = [Line(delay_s, loss=loss, command_hz=command_hz) for loss in (0.0, 0.05)]
            ideal, lossy = (Run(line, 1).run(20) for line in lines)
            print(
                f"  {name}, cmd_vel {command_hz} Hz: {100 * lossy.published / ideal.published:.1f} %, "
                f"{lossy.failed} failed, {lossy.sends_per_message:.3f} sends per message"
            )


async def main(seconds: float) -> None:
    master = await started("simple_ros_master", "--port", "0")
    assert master.stdout is not None
    address = (await master.stdout.readline()).decode().rsplit(" ", 1)[1].strip()
    with tempfile.TemporaryDirectory() as state:
        bench = Bench(address, Path(state), seconds)
        try:
            await bench.clean()
            for command_hz in (20, 100):
                await bench.bad_cable(command_hz)
            await bench.restart()
            await bench.control()
        finally:
            for child in _children:
                await ended(child)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="of the clean run")
    options = parser.parse_args()
    simulated()
    asyncio.run(main(options.seconds))

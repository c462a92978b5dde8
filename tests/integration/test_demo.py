"""``simple-ros demo`` as a user runs it: real processes, signals, a terminal."""

from __future__ import annotations

import asyncio
import fcntl
import os
import pty
import re
import signal
import socket
import struct
import sys
import termios
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import psutil
import pytest
from support.processes import Process, python
from support.waiting import Stopwatch, until

from simple_ros.demos.processes import ProcessEnded, Processes

PROGRAM = ("-m", "simple_ros.cli.main", "demo", "--no-foxglove")
RATE = re.compile(r"(quad_\w+) ([\d.]+) Hz")
TOPICS = {"quad_odometry", "quad_marker_array", "quad_path_short", "quad_path_incremental"}


@asynccontextmanager
async def flying() -> AsyncIterator[tuple[Process, list[psutil.Process]]]:
    """A demo whose messages flow, and its children."""
    async with python(*PROGRAM, "--plain", "--master-port", "0") as demo:
        while "messages flow" not in await demo.line():
            pass
        children = psutil.Process(demo.pid).children(recursive=True)
        assert len(children) == 3
        yield demo, children


def has_ended(process: psutil.Process) -> bool:
    """Whether it has, be it that nobody has asked for its exit code yet."""
    try:
        return process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def all_ended(processes: list[psutil.Process]) -> bool:
    return all(map(has_ended, processes))


async def test_it_flies_and_ends_by_itself() -> None:
    async with python(*PROGRAM, "--plain", "--master-port", "0", "--duration", "3") as demo:
        assert re.match(r"the Master is at 127\.0\.0\.1:\d+; ", await demo.line())
        while "messages flow" not in await demo.line():
            pass
        watch = Stopwatch()
        output = [await demo.line()]
        while not output[-1].startswith("demo over: "):
            output.append(await demo.line())
        busy = watch.hindered / watch.passed
        rates = [dict(RATE.findall(line)) for line in output if "Hz" in line]
        assert await demo.wait() == 0
        assert await demo.errors() == ""
    assert set(rates[-1]) == TOPICS
    # A process that stood still for a moment has spoilt some of the lines.
    nearest = [min(abs(float(found[topic]) - 50.0) for found in rates) for topic in TOPICS]
    assert max(nearest) <= 5.0 + 50.0 * busy


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
async def test_a_signal_ends_all_of_it(number: int) -> None:
    async with flying() as (demo, children):
        # Ctrl-C reaches the process group of the terminal: the demo, but not its children.
        groups = {os.getpgid(child.pid) for child in children}
        assert groups == {child.pid for child in children}
        demo.signal(number)
        assert await demo.wait() == 0
        assert all_ended(children)
        assert await demo.errors() == ""


async def test_children_end_when_the_demo_is_killed() -> None:
    async with flying() as (demo, children):
        demo.signal(signal.SIGKILL)
        assert await demo.wait() == -signal.SIGKILL
        await until(lambda: all_ended(children), "every child ended")


async def test_a_child_that_ends_ends_all_of_it() -> None:
    async with flying() as (demo, children):
        (simulator,) = (child for child in children if "quad_simulator" in str(child.cmdline()))
        simulator.kill()
        assert await demo.wait() == 1
        assert await demo.errors() == "error: quad_simulator killed by SIGKILL\n"
        assert all_ended(children)


async def test_messages_that_stop_are_the_reason_and_a_stuck_child_is_killed() -> None:
    # After 1 s without messages a topic counts as silent.
    arguments = ("--plain", "--master-port", "0", "--duration", "3")
    async with python(*PROGRAM, *arguments) as demo:
        while "messages flow" not in await demo.line():
            pass
        children = psutil.Process(demo.pid).children(recursive=True)
        (visualizer,) = (child for child in children if "quad_visualizer" in str(child.cmdline()))
        visualizer.suspend()
        assert await demo.wait() == 1
        error = "error: no messages on quad_marker_array, quad_path_short, quad_path_incremental "
        assert await demo.errors() == f"{error}after 3 s\n"
        assert all_ended(children)


async def test_a_taken_port_is_left_alone() -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder:
        taken = holder.getsockname()[1]
        arguments = ("--plain", "--master-port", str(taken), "--duration", "1")
        async with python(*PROGRAM, *arguments) as demo:
            said = await demo.line()
            assert await demo.wait() == 0
    match = re.match(rf"port {taken} is taken, so this Master is at (127\.0\.0\.1:\d+); ", said)
    assert match is not None
    assert f"export SIMPLE_ROS_MASTER={match[1]};" in said
    assert not match[1].endswith(f":{taken}")


async def test_on_a_terminal_it_draws_a_screen_and_gives_it_back() -> None:
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    environment = {**os.environ, "TERM": "xterm-256color", "PYTHONUTF8": "1"}
    arguments = (*PROGRAM, "--master-port", "0", "--duration", "1")
    demo = await asyncio.create_subprocess_exec(
        sys.executable, *arguments, stdin=theirs, stdout=theirs, stderr=theirs, env=environment
    )
    os.close(theirs)
    reading = asyncio.create_task(asyncio.to_thread(read_all, ours))
    assert await demo.wait() == 0
    text = await reading
    os.close(ours)
    for word in ("Master at 127.0.0.1:", "quad_path_short", "from above", "●", "export SIMPLE_ROS"):
        assert word in text
    show, leave = "\x1b[?1049h", "\x1b[?1049l"
    assert text.index(show) < text.index("from above") < text.rindex(leave)
    assert "demo over: " in text[text.rindex(leave) :]


def read_all(terminal: int) -> str:
    """Everything written to a terminal until nobody has it open."""
    chunks = []
    try:
        while chunk := os.read(terminal, 65536):
            chunks.append(chunk)
    except OSError:
        pass
    return b"".join(chunks).decode()


class TestProcesses:
    async def test_how_a_child_ended_and_its_last_words(self) -> None:
        async with Processes() as processes:
            code = "import sys; print('hello'); sys.exit('first\\nlast')"
            child = await processes.start("short", [sys.executable, "-c", code])
            assert await child.line_with("ell") == "hello"
            ended = await processes.first_end()
            assert (ended.name, ended.state) == ("short", "ended with code 1")
            assert str(ended) == "short ended with code 1; last line on its stderr: last"
            assert child.meter.usage() is None
            with pytest.raises(ProcessEnded):
                await child.line_with("never said")

    async def test_a_program_that_is_not_there(self) -> None:
        async with Processes() as processes:
            await processes.start("nothing", ["/no/such/program"])
            ended = await processes.first_end()
            assert ended.last_words == "cannot run /no/such/program: No such file or directory"

    async def test_who_ignores_sigterm_is_killed(self) -> None:
        code = "import signal; signal.signal(15, signal.SIG_IGN); print('up'); signal.pause()"
        async with Processes(grace_s=0.05) as processes:
            child = await processes.start("stubborn", [sys.executable, "-uc", code])
            await child.line_with("up")
            usage = child.meter.usage()
            assert usage is not None
            assert usage.memory_bytes > 0
        assert child.state == "killed by SIGKILL"
        assert not child.is_running

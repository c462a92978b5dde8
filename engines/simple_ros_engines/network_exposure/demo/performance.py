"""One run of the demo: starts the programs, plays the story to the mock network, prints what is heard."""

from __future__ import annotations

import asyncio
import math
import os
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

import typer

from simple_ros.demos.ports import free_port
from simple_ros.demos.processes import DemoProcess, ProcessEnded, Processes
from simple_ros.msg.network_exposure_msgs import (
    FlowQosArray,
    QosAdvice,
    Throttle,
    UniqueTopicFlows,
)
from simple_ros.msg.turtlesim_msgs import AdaptationRequest, ControlStatus
from simple_ros.node import NodeHandle
from simple_ros.qos import LATCHED, QosProfile
from simple_ros_engines.network_exposure.demo.narrator import Line, Narrator
from simple_ros_engines.network_exposure.demo.story import WINDOW_S, Act, Pacing, Step, Story
from simple_ros_engines.network_exposure.exposure.api import ApiClient
from simple_ros_engines.network_exposure.exposure.http import StandardTransport

__all__ = ["NODE_NAME", "Performance", "Wishes"]

NODE_NAME = "turtlesim_demo"
_HERE = Path(__file__).parent
_LAUNCH = _HERE.parent / "turtlesim" / "launch" / "turtlesim.yaml"
_POLICY = _HERE / "policy.json"
_TURTLES = ("turtle1", "turtle2")
_TOPICS = frozenset(f"{turtle}/{name}" for turtle in _TURTLES for name in ("pose", "cmd_vel"))
_RELAYED = r"^/?turtle\d+/(pose|cmd_vel)$"
"""Whoever subscribes these is a flow more, with a request of its own."""
_TICK_S = 0.1
_GRACE_S = 8.0
_COLOURS = {
    "story": "bright_white",
    "tag": "cyan",
    "flow": "cyan",
    "request": "blue",
    "bearer": "green",
    "downgrade": "red",
    "refused": "red",
    "failed": "red",
    "maximizer": "magenta",
    "adapt": "yellow",
    "turtle": "yellow",
    "MOS": "bright_green",
}


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the user wants; see the command. Ports of 0 are any; 0 seconds and rounds are for ever."""

    duration_s: float = 0.0
    rounds: int = 0
    pace_s: float = 15.0
    setup_s: float = 2.0
    is_plain: bool = False
    master_port: int = 50051
    turtles_port: int = 8091
    scores_port: int = 8090
    foxglove_port: int | None = 8765
    record: Path | None = None


class Performance:
    """The run.

    Args:
        wishes: Of the user.
    """

    def __init__(self, wishes: Wishes) -> None:
        self._wishes = wishes
        self._pacing = Pacing(wishes.pace_s, wishes.setup_s)
        self._story = Story(_TOPICS, self._pacing)
        self._narrator = Narrator(min(10.0, wishes.pace_s))
        self._processes = Processes(_GRACE_S)
        self._clock = asyncio.get_running_loop().time
        self._begun_s = self._clock()
        self._master = ""
        self._network = ""
        self._watching: list[asyncio.Task[None]] = []
        self._ended: asyncio.Future[ProcessEnded] = asyncio.get_running_loop().create_future()

    async def run(self) -> None:
        """Play; all programs have ended when this returns, raises or is cancelled.

        Raises:
            ProcessEnded: A program ended by itself.
        """
        async with self._processes:
            playing = asyncio.create_task(self._play())
            try:
                await asyncio.wait((self._ended, playing), return_when=asyncio.FIRST_COMPLETED)
                if self._ended.done():
                    raise self._ended.result()
                await playing
            finally:
                for task in (playing, *self._watching):
                    task.cancel()
                await asyncio.gather(playing, *self._watching, return_exceptions=True)

    # -- programs ------------------------------------------------------------------------------

    async def _start_network(self) -> None:
        wishes = self._wishes
        master = await self._program(
            "master", "simple_ros_master", "--port", _port(wishes.master_port)
        )
        mock = await self._tool(
            "mock network", "network", "mock", "--port", "0", "--setup", f"{wishes.setup_s:g}"
        )
        self._master = (await master.line_with("listening on ")).rpartition(" ")[2]
        line = await mock.line_with("listens on ")
        self._network = line.partition("listens on ")[2].split()[0]
        self._say(
            "story", f"the Master is at {self._master}; the network at {self._network} is simulated"
        )

    async def _start_turtles(self) -> None:
        wishes = self._wishes
        pages = (
            f"page:=127.0.0.1:{_port(wishes.turtles_port)}",
            f"scores:=127.0.0.1:{_port(wishes.scores_port)}",
        )
        launched = await self._tool(
            "turtles", "launch", str(_LAUNCH), "--plain", "--master", "require",
            *pages, "mock:=false", f"url:={self._network}",
            f"window_s:={WINDOW_S}", f"dwell_s:={self._pacing.dwell_s}",
        )  # fmt: skip
        bridge = await self._start_bridge()
        for what, text in (("turtles", "the turtles are at "), ("scores", "scores are given at ")):
            line = await launched.line_with(text)
            self._say("story", f"{what}: {line.partition(text)[2].strip()}")
        if bridge is not None:
            link = (await bridge.line_with("open ")).partition("open ")[2]
            self._say("story", f"in Foxglove: open {link}; --layout prints a layout for it")
        if wishes.record is not None:
            words = ("bag", "record", "--all", "-x", _RELAYED, "-o", str(wishes.record))
            await self._tool("recorder", *words)
            self._say("story", f"all but relayed topics are recorded in {wishes.record}")

    async def _start_bridge(self) -> DemoProcess | None:
        port = self._wishes.foxglove_port
        if port is None:
            return None
        return await self._tool("foxglove", "foxglove", "--port", _port(port))

    async def _start_maximizer(self) -> None:
        # As the environment says it to programs of a launch file.
        words = (
            "policy:=" + str(_POLICY),
            f"period_s:={self._pacing.period_s:g}",
            f"settle_s:={self._pacing.settle_s:g}",
            f"patience_s:={self._pacing.patience_s:g}",
        )
        await self._tool(
            "maximizer", "engine", "run", "maximizer", words=tuple(f"_{word}" for word in words)
        )

    async def _tool(self, name: str, *arguments: str, words: tuple[str, ...] = ()) -> DemoProcess:
        return await self._program(name, "simple_ros.cli.main", *arguments, words=words)

    async def _program(
        self, name: str, module: str, *arguments: str, words: tuple[str, ...] = ()
    ) -> DemoProcess:
        more: dict[str, str | None] = {
            "SIMPLE_ROS_MASTER": self._master or None,
            "PATH": _path_of_programs(),
        }
        if words:
            more["SIMPLE_ROS_ARGS"] = " ".join(words)
        command = [sys.executable, "-m", module, *arguments]
        program = await self._processes.start(name, command, more)
        self._watching.append(asyncio.create_task(self._watch(program)))
        return program

    async def _watch(self, program: DemoProcess) -> None:
        """No program of the demo ends by itself, unless something is wrong."""
        how = await program.ended()
        if not self._ended.done():
            self._ended.set_result(how)

    # -- the story -----------------------------------------------------------------------------

    async def _play(self) -> None:
        await self._start_network()
        async with NodeHandle(NODE_NAME, master=self._master) as node:
            await self._listen(node)
            await self._start_turtles()
            client = ApiClient(self._network, StandardTransport())
            end_s = self._begun_s + (self._wishes.duration_s or math.inf)
            while self._clock() < end_s:
                lines = self._narrator.tick(self._clock())
                if any(line.word == "maximizer" for line in lines):
                    self._story.eased(self._clock())
                self._tell(lines)
                step = self._story.tick(self._clock())
                if step is not None:
                    if self._is_over(step):
                        break
                    await self._perform(step, client)
                await asyncio.sleep(_TICK_S)
        self._say(
            "story", f"the end: the network ran short and recovered {_times(self._story.rounds)}"
        )

    def _is_over(self, step: Step) -> bool:
        wanted = self._wishes.rounds
        return bool(wanted) and step.act is Act.SHORT and self._story.rounds >= wanted

    async def _perform(self, step: Step, client: ApiClient) -> None:
        self._say("story", step.text)
        if step.act is Act.AT_EASE:
            await self._start_maximizer()
            return
        await client.call("POST", "/mock/control", {"least_delay_ms": step.least_delay_ms})

    async def _listen(self, node: NodeHandle) -> None:
        deep = QosProfile(depth=100)
        await node.subscribe(
            "/unique_network_flow", UniqueTopicFlows, self._flows_came, qos=LATCHED
        )
        await node.subscribe("/network_flow_state", FlowQosArray, self._states_came, qos=LATCHED)
        await node.subscribe(
            "/qos_advice",
            QosAdvice,
            lambda told: self._narrator.advised(told, self._clock()),
            qos=deep,
        )
        await node.subscribe(
            "/throttle",
            Throttle,
            lambda told: self._narrator.throttled(told, self._clock()),
            qos=deep,
        )
        await node.subscribe(
            "/application_adaptation_request", AdaptationRequest, self._asked, qos=deep
        )
        for turtle in _TURTLES:
            await node.subscribe(f"/{turtle}/control_status", ControlStatus, self._drives)

    def _flows_came(self, message: UniqueTopicFlows) -> None:
        self._tell(self._narrator.relayed(message))

    def _states_came(self, message: FlowQosArray) -> None:
        self._story.flows_are(message)
        self._tell(self._narrator.states(message, self._clock()))

    def _asked(self, message: AdaptationRequest) -> None:
        self._tell(self._narrator.asked(message))

    def _drives(self, message: ControlStatus) -> None:
        self._story.scored(message.turtle, message.mos)
        self._story.slowed(message.turtle, is_slowed=message.speed_factor < 1)
        self._tell(self._narrator.drives(message))

    # -- what is printed -----------------------------------------------------------------------

    def _tell(self, lines: list[Line]) -> None:
        for line in lines:
            self._say(line.word, line.text)

    def _say(self, word: str, text: str) -> None:
        shown = f"{word:<10}"
        if not self._wishes.is_plain:
            shown = typer.style(shown, fg=_COLOURS[word])
        typer.echo(f"{self._clock() - self._begun_s:6.1f} s  {shown} {text}")


def _path_of_programs() -> str:
    """Launch files look for ``simple-ros`` there; who started this by its path need not have it in theirs."""
    return os.pathsep.join((sysconfig.get_path("scripts"), os.environ.get("PATH", os.defpath)))


def _times(number: int) -> str:
    return "once" if number == 1 else f"{number} times"


def _port(first: int) -> str:
    return str(free_port(first))

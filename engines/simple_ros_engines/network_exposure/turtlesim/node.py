"""Turtlesim as a node: turtles that are driven over topics, and a page to watch them."""

from __future__ import annotations

import asyncio
import logging
import random
from collections.abc import Awaitable
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Protocol

from simple_ros.engine import Engine
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.std_srvs import Empty, EmptyRequest, EmptyResponse
from simple_ros.msg.turtlesim_msgs import (
    AdaptationRequest,
    Kill,
    KillRequest,
    KillResponse,
    Mos,
    Pose,
    SetPen,
    SetPenRequest,
    SetPenResponse,
    Spawn,
    SpawnRequest,
    SpawnResponse,
    TeleportAbsolute,
    TeleportAbsoluteRequest,
    TeleportAbsoluteResponse,
    TeleportRelative,
    TeleportRelativeRequest,
    TeleportRelativeResponse,
)
from simple_ros.msg.visualization_msgs import MarkerArray
from simple_ros.net.addresses import address_of
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import SENSOR_DATA, QosProfile
from simple_ros_engines.network_exposure.mos.judgements import Judgements
from simple_ros_engines.network_exposure.mos.node import MOS_TOPIC, judge_of
from simple_ros_engines.network_exposure.mos.page_server import Feed, PageServer
from simple_ros_engines.network_exposure.turtlesim.adaptation import (
    ADAPTATION_TOPIC,
    Adaptations,
    is_meant,
)
from simple_ros_engines.network_exposure.turtlesim.markers import markers
from simple_ros_engines.network_exposure.turtlesim.picture import Picture
from simple_ros_engines.network_exposure.turtlesim.world import (
    Pen,
    Slip,
    Turtle,
    TurtleRefused,
    World,
)

__all__ = ["TAG", "Turtlesim"]

logger = logging.getLogger(__name__)

TAG = "_qos"
"""What makes a relay hand a topic on."""
_WEB = Path(__file__).parent / "web"
_MARKERS_S = 0.1
_PAGE_S = 0.05
SLIP_TAU_S = 0.3
_LONGEST_STEP_S = 0.1
_PLACES = ((5.544, 5.544), (8.3, 5.544), (2.8, 5.544), (5.544, 8.3), (5.544, 2.8))


class _Closable(Protocol):
    def close(self) -> Awaitable[None]: ...


class Turtlesim(Engine):
    """Simulates the turtles.

    Each has the topics ``NAME/pose`` + tag and ``NAME/cmd_vel`` and the services ``NAME/set_pen``,
    ``NAME/teleport_absolute`` and ``NAME/teleport_relative``; all together ``spawn``, ``kill``, ``clear`` and
    ``reset``. Parameters of its node: ``tag`` (of the topics it publishes; empty without a relay), ``rate``
    (poses a second), ``turtles`` (at the beginning), ``page`` (``[HOST:]PORT`` of the page; port 0 takes any),
    ``background`` (red, green, blue), ``slip`` (rad/s, standard deviation of turns that nobody asked for).
    When an application is asked to be less frequent, poses of its turtle are, too.

    Attributes:
        world: The turtles.
    """

    node_name: ClassVar[str] = "turtlesim"
    summary: ClassVar[str] = "Turtles on a plane, driven over topics, with a page to watch them."

    def __init__(self) -> None:
        self.world = World()
        self._handles: dict[str, list[_Closable]] = {}
        self._poses: dict[str, Publisher[Pose]] = {}
        self._node: NodeHandle | None = None
        self._tag = TAG
        self._turtles = 1
        self._background = (69, 86, 255)
        self._changing = asyncio.Lock()
        self._judgements = Judgements()
        self._adaptations: dict[str, Adaptations] = {}
        self._due: dict[str, float] = {}
        self._page = PageServer(_WEB, self._feed, period_s=_PAGE_S)

    @property
    def url(self) -> str:
        """Where the page is, while there is one."""
        return self._page.url

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends.

        Raises:
            ConfigError: ``page`` is no address.
        """
        self._node = node
        get = node.declare_parameter
        self._tag = str(await get("~tag", TAG, read_only=True))
        rate_hz = float(await get("~rate", 62.5, minimum=1, maximum=1000, read_only=True))
        self._turtles = int(await get("~turtles", 1, minimum=0, maximum=64, read_only=True))
        host, port = address_of(str(await get("~page", "127.0.0.1:8091", read_only=True)), "~page")
        slip = float(await get("~slip", 0.0, minimum=0, maximum=5, read_only=True))
        self.world = World(Slip(slip, SLIP_TAU_S, partial(random.gauss, 0.0, 1.0)))
        colour = await get("~background", list(self._background), minimum=0, maximum=255)
        self._set_background(colour)
        node.on_parameter_changed("~background", self._set_background)
        await self._spawn_first()
        await node.advertise_service("spawn", Spawn, self._spawn)
        await node.advertise_service("kill", Kill, self._kill)
        await node.advertise_service("clear", Empty, self._clear)
        await node.advertise_service("reset", Empty, self._reset)
        await node.subscribe(MOS_TOPIC, Mos, self._score_came)
        await node.subscribe(ADAPTATION_TOPIC, AdaptationRequest, self._adapt)
        shown = await node.advertise("turtlesim/markers", MarkerArray, qos=QosProfile(depth=1))
        node.create_timer(_MARKERS_S, lambda _: self._show(shown))
        async with AsyncExitStack() as stack:
            url = await stack.enter_async_context(self._page.listening(host, port))
            if url:
                # With port 0 nobody else knows.
                print(f"the turtles are at {url}", flush=True)
            await self._simulate(1 / rate_hz)

    async def _simulate(self, period_s: float) -> None:
        loop = asyncio.get_running_loop()
        due = before = loop.time()
        while True:
            due = max(due + period_s, loop.time() - period_s)
            await asyncio.sleep(due - loop.time())
            now_s = loop.time()
            # After a pause of the process the turtles go on from where they stood.
            span_s, before = min(_LONGEST_STEP_S, now_s - before), now_s
            for turtle in self.world.step(span_s, now_s):
                logger.warning(
                    "%s ran into the wall at %.2f, %.2f", turtle.name, turtle.x, turtle.y
                )
            for name, publisher in self._poses.items():
                if name in self.world.turtles and self._is_due(name, now_s):
                    publisher.publish(_pose(self.world.turtles[name]))

    def _is_due(self, name: str, now_s: float) -> bool:
        """Whether a pose is to be sent at this step."""
        rate = self._adaptations[name].rate(now_s) if name in self._adaptations else 1.0
        due = self._due.get(name, 0.0) + min(1.0, rate)
        self._due[name] = due - 1.0 if due >= 1.0 else due
        return due >= 1.0

    def _adapt(self, request: AdaptationRequest) -> None:
        """Poses of the turtles that are meant go out less often."""
        now_s = asyncio.get_running_loop().time()
        for name in self.world.turtles:
            if is_meant(request.group, request.topics, name, (f"{name}/pose",)):
                self._adaptations.setdefault(name, Adaptations()).came(
                    request.requester,
                    request.speed_factor,
                    request.rate_factor,
                    request.valid_s,
                    now_s,
                    request.reason,
                )

    # -- turtles come and go -----------------------------------------------------------------------

    async def _spawn_first(self) -> None:
        for number in range(self._turtles):
            x, y = _PLACES[number % len(_PLACES)]
            await self._open(self.world.spawn(x, y, 0.0))

    async def _open(self, turtle: Turtle) -> None:
        node, name = self._node, turtle.name
        assert node is not None
        handles: list[Any] = self._handles.setdefault(name, [])
        pose = await node.advertise(f"{name}/pose{self._tag}", Pose, qos=SENSOR_DATA)
        handles.append(pose)
        handles.append(
            await node.subscribe(
                f"{name}/cmd_vel", Twist, partial(self._command, name), qos=QosProfile(depth=1)
            )
        )
        offer = node.advertise_service
        handles += [
            await offer(f"{name}/set_pen", SetPen, partial(self._set_pen, name)),
            await offer(
                f"{name}/teleport_absolute", TeleportAbsolute, partial(self._teleport, name)
            ),
            await offer(
                f"{name}/teleport_relative", TeleportRelative, partial(self._teleport_by, name)
            ),
        ]
        self._poses[name] = pose

    async def _close(self, name: str) -> None:
        for known in (self._poses, self._adaptations, self._due):
            known.pop(name, None)
        for handle in reversed(self._handles.pop(name, [])):
            await handle.close()

    def _command(self, name: str, message: Twist) -> None:
        now_s = asyncio.get_running_loop().time()
        linear, angular = message.linear, message.angular
        if not self.world.command(name, linear.x, linear.y, angular.z, now_s):
            logger.warning("%s was told to drive by what is no number", name)

    # -- services ----------------------------------------------------------------------------------

    async def _spawn(self, request: SpawnRequest) -> SpawnResponse:
        async with self._changing:
            try:
                turtle = self.world.spawn(request.x, request.y, request.theta, request.name)
            except TurtleRefused as refused:
                return SpawnResponse(message=str(refused))
            await self._open(turtle)
        return SpawnResponse(name=turtle.name)

    async def _kill(self, request: KillRequest) -> KillResponse:
        async with self._changing:
            try:
                self.world.kill(request.name)
            except TurtleRefused as refused:
                return KillResponse(message=str(refused))
            await self._close(request.name)
        return KillResponse(success=True)

    def _clear(self, _: EmptyRequest) -> EmptyResponse:
        self.world.clear()
        return EmptyResponse()

    async def _reset(self, _: EmptyRequest) -> EmptyResponse:
        async with self._changing:
            names = list(self.world.turtles)
            self.world.reset()
            for name in names:
                await self._close(name)
            await self._spawn_first()
        return EmptyResponse()

    def _set_pen(self, name: str, request: SetPenRequest) -> SetPenResponse:
        r, g, b, width = (min(255, n) for n in (request.r, request.g, request.b, request.width))
        self.world.set_pen(name, Pen(r, g, b, width, request.off))
        return SetPenResponse()

    def _teleport(self, name: str, request: TeleportAbsoluteRequest) -> TeleportAbsoluteResponse:
        self.world.teleport(name, request.x, request.y, request.theta)
        return TeleportAbsoluteResponse()

    def _teleport_by(self, name: str, request: TeleportRelativeRequest) -> TeleportRelativeResponse:
        self.world.teleport_by(name, request.linear, request.angular)
        return TeleportRelativeResponse()

    # -- what is shown -----------------------------------------------------------------------------

    def _set_background(self, value: Any) -> None:
        if len(value) != 3:
            logger.warning("background must be red, green and blue, not %s", value)
            return
        red, green, blue = (int(part) for part in value)
        self._background = (red, green, blue)

    def _score_came(self, message: Mos) -> None:
        judge = judge_of(message)
        if judge is not None:
            now_s = asyncio.get_running_loop().time()
            self._judgements.came(message.group, message.topics, message.score, judge, now_s)

    def _show(self, publisher: Publisher[MarkerArray]) -> None:
        if publisher.subscriber_count:
            publisher.publish(markers(self.world, self._background))

    def _feed(self) -> Feed:
        picture = Picture(self.world, self._background)

        def state() -> dict[str, Any]:
            now_s = asyncio.get_running_loop().time()
            scores = {
                name: None if judged is None else round(judged.score, 2)
                for name in self.world.turtles
                for judged in (self._judgements.of(f"{name}/pose", now_s),)
            }
            asked = {
                name: one.reason(now_s) or "no reason given"
                for name, one in self._adaptations.items()
                if one.speed(now_s) < 1 or one.rate(now_s) < 1
            }
            return {**picture.state(), "scores": scores, "asked": asked}

        return state


def _pose(turtle: Turtle) -> Pose:
    return Pose(
        x=turtle.x,
        y=turtle.y,
        theta=turtle.theta,
        linear_velocity=turtle.linear,
        angular_velocity=turtle.angular,
    )

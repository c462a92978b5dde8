"""The transparent bridge: camera and lidar topics, made smaller when the link asks for it."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

from google.protobuf.message import DecodeError, Message

from simple_ros.engine import Engine
from simple_ros.msg.sensor_msgs import CompressedImage, Image, PointCloud2
from simple_ros.msg.std_msgs import String
from simple_ros.msg.wireless_ros_msgs import Constraint
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros_engines.base import NAMESPACE
from simple_ros_engines.cross_domain.adaptation import scaled, voxels
from simple_ros_engines.cross_domain.flow_rules import FlowRules
from simple_ros_engines.cross_domain.jpeg import Look, pillow, to_jpeg
from simple_ros_engines.cross_domain.sensing import voxel_leaf_m
from simple_ros_engines.cross_domain.treatment import Treatment, TreatmentJudge, fair_rates
from simple_ros_engines.marking import marked
from simple_ros_engines.own_link import is_meant
from simple_ros_engines.physical_adaptive.actuators import Actuator, Applied
from simple_ros_engines.physical_adaptive.sending import PriorityActuator, StrategyApplier
from simple_ros_engines.physical_adaptive.strategy import Strategy

__all__ = ["TopicBridge"]

logger = logging.getLogger(__name__)

_Shrink = Callable[[bytes], Any]
_Handle = Callable[["_Flow", bytes, float], Any]


@dataclass(slots=True)
class _Flow:
    publisher: Publisher[Message]
    rules: FlowRules = field(default_factory=FlowRules)
    jpeg: Publisher[CompressedImage] | None = None
    came: int = 0
    passed: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    malformed: int = 0
    busy: bool = False

    def sent(self, data: bytes, look: Look | None = None) -> None:
        self.passed += 1
        self.bytes_out += len(data)
        self.rules.sent(len(data), look)


class TopicBridge(Engine):
    """Hands camera pictures and lidar clouds on, smaller while the link's constraint or strategy says so.

    A link that is healthy and wide enough gets the bytes as they came. Parameters of its node: ``image_in``, ``image_out``,
    ``cloud_in``, ``cloud_out`` (topics; an empty ``..._in`` is left out), ``image_format`` (``raw``, or
    ``jpeg``: pictures that are made smaller go to ``image_out`` + ``/compressed``), ``link`` (whose
    constraints and strategies count; empty takes any), ``point_spacing_m``, ``dwell_s`` (how long the link
    must have been better before more is sent), ``rate_share`` (of the strategy's bits a second, for all its
    topics together), ``priority_offset`` (added to the link's priority: commands go before pictures).
    """

    node_name: ClassVar[str] = f"{NAMESPACE}/topic_bridge"
    summary: ClassVar[str] = "Camera and lidar topics, made smaller when the link asks for it."

    def __init__(self) -> None:
        self.flows: dict[str, _Flow] = {}
        self.judge = TreatmentJudge()
        self._node: NodeHandle | None = None
        self._spacing_m = 0.05
        self._link = ""
        self._share = 0.8
        self._offset = -2

    @property
    def scale(self) -> float:
        """Of pictures, per cent."""
        return self.judge.treatment.scale

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends.

        Raises:
            ConfigError: JPEG is wanted and Pillow is not installed.
        """
        get = node.declare_parameter
        image_in = str(await get("~image_in", "/camera/image_raw", read_only=True))
        image_out = str(await get("~image_out", "/camera/mobile/image_raw", read_only=True))
        cloud_in = str(await get("~cloud_in", "/lidar/points", read_only=True))
        cloud_out = str(await get("~cloud_out", "/lidar/mobile/points", read_only=True))
        form = str(await get("~image_format", "raw", choices=("raw", "jpeg"), read_only=True))
        self._link = str(await get("~link", "", read_only=True))
        self._spacing_m = float(await get("~point_spacing_m", 0.05, minimum=0.001, read_only=True))
        self._share = float(await get("~rate_share", 0.8, minimum=0.01, maximum=1, read_only=True))
        self._offset = int(await get("~priority_offset", -2, minimum=-4, maximum=4, read_only=True))
        dwell_s = float(await get("~dwell_s", 2.0, minimum=0, maximum=60, read_only=True))
        self.judge = TreatmentJudge(dwell_s)
        if form == "jpeg":
            # Better to know now than at the first picture on a bad link.
            pillow()
        self._node = node
        actuators: list[Actuator] = [_BridgeActuator(self)]
        if image_in:
            flow = await self._join(image_in, image_out, Image, self._picture_came, actuators)
            flow.rules = FlowRules(dwell_s)
            if form == "jpeg":
                flow.jpeg = await self._advertised(
                    f"{image_out}/compressed", CompressedImage, actuators
                )
        if cloud_in:
            await self._join(cloud_in, cloud_out, PointCloud2, self._cloud_came, actuators)
        await node.subscribe(f"/{NAMESPACE}/constraints", Constraint, self._constraint)
        await StrategyApplier(node, actuators, self._link, "topic_bridge/").start()
        told = await node.advertise(f"/{NAMESPACE}/bridge_statistics", String)
        node.create_timer(1.0, lambda _: told.publish(String(data=self.statistics())))
        await node.spin()

    async def _join(
        self,
        source: str,
        sink: str,
        kind: type[Image | PointCloud2],
        came: _Handle,
        actuators: list[Actuator],
    ) -> _Flow:
        assert self._node is not None
        flow = self.flows[source] = _Flow(await self._advertised(sink, kind, actuators))
        await self._node.subscribe(
            source, kind.DESCRIPTOR.full_name, partial(self._came, flow, came), raw=True
        )
        return flow

    async def _advertised(
        self, topic: str, kind: type[Any], actuators: list[Actuator]
    ) -> Publisher[Any]:
        """A publisher whose connections carry the strategy's priority."""
        assert self._node is not None
        ways, marks = marked(self._node.transports)
        actuators.append(PriorityActuator(marks, self._offset))
        return await self._node.advertise(topic, kind, transports=ways)

    # -- what it is told -------------------------------------------------------------------------

    def _constraint(self, message: Constraint) -> None:
        if is_meant(self._link, message.link_id):
            self.judge.constraint(message.resolution_scale, message.frame_rate, time.monotonic())

    def take_strategy(self, strategy: Strategy) -> str:
        """Send as a strategy says; what that means, in words."""
        now_s = time.monotonic()
        self.judge.strategy(strategy.compression_ratio, now_s)
        heard = [flow for flow in self.flows.values() if self._is_heard(flow)]
        rate_bps = self._share * strategy.rate_bps
        # A rate of 0 with blocks to use says nothing; without any it is the hub's refusal.
        is_told = rate_bps > 0 or strategy.prb == 0
        wanted = [flow.rules.wanted_bps(as_jpeg=_is_jpeg_heard(flow)) for flow in heard]
        given = dict(zip(map(id, heard), fair_rates(rate_bps, wanted), strict=True))
        for flow in self.flows.values():
            # Nobody hears the others now; who begins to is not to wait for the next strategy.
            bps = given.get(id(flow), rate_bps) if is_told else math.inf
            flow.rules.strategy(bps, strategy.compression_ratio, now_s)
        told = [f"ratio {self.judge.treatment.ratio:.2f}, {rate_bps / 1e6:.2f} Mbit/s"]
        told += [f"{topic}: {_told(flow)}" for topic, flow in self.flows.items()]
        return "; ".join(told)

    def _is_heard(self, flow: _Flow) -> bool:
        return _is_jpeg_heard(flow) or flow.publisher.subscriber_count > 0

    # -- messages --------------------------------------------------------------------------------

    async def _came(self, flow: _Flow, handle: _Handle, data: bytes) -> None:
        now_s = time.monotonic()
        flow.came += 1
        flow.bytes_in += len(data)
        flow.rules.came(len(data), now_s)
        if self._is_heard(flow):
            await handle(flow, data, now_s)

    async def _pass(
        self, flow: _Flow, now_s: float, expected_bytes: float | None, work: Callable[[], Any]
    ) -> None:
        """Do the work, if a message fits; what cannot be made small enough must be sent less often."""
        if flow.busy or not flow.rules.passes(self.judge.treatment, now_s, expected_bytes):
            return
        flow.busy = True
        try:
            await work()
        except DecodeError:
            flow.malformed += 1
        finally:
            flow.busy = False

    async def _picture_came(self, flow: _Flow, data: bytes, now_s: float) -> None:
        treatment, rules = self.judge.treatment, flow.rules
        fits = treatment.is_untouched and rules.fits_as_it_came(len(data), now_s)
        is_raw_heard = flow.publisher.subscriber_count > 0
        if _is_jpeg_heard(flow) and not (fits and is_raw_heard):
            look = rules.look(treatment, now_s)
            work = partial(self._send_jpeg, flow, data, look)
            await self._pass(flow, now_s, rules.ladder.expected_bytes(), work)
        elif is_raw_heard:
            shrink = partial(_smaller_image, scale=_plain_scale(treatment))
            plain = None if treatment.is_untouched else shrink
            await self._pass(flow, now_s, None, partial(self._send, flow, data, plain))

    async def _send_jpeg(self, flow: _Flow, data: bytes, look: Look) -> None:
        assert flow.jpeg is not None
        out = await asyncio.to_thread(_jpeg, data, look)
        if out is None:
            # Nothing that JPEG knows: better the picture as it is than none.
            await self._send(flow, data, None)
            return
        flow.sent(out, look)
        flow.jpeg.publish_bytes(out)

    async def _cloud_came(self, flow: _Flow, data: bytes, now_s: float) -> None:
        share = flow.rules.cloud_share(self.judge.treatment, len(data), now_s)
        expected = flow.rules.cloud_bytes(share, len(data))
        await self._pass(flow, now_s, expected, partial(self._send_cloud, flow, data, share))

    async def _send_cloud(self, flow: _Flow, data: bytes, share: float) -> None:
        shrink = partial(_smaller_cloud, leaf_m=voxel_leaf_m(share, self._spacing_m))
        out = await self._send(flow, data, None if share == 1 else shrink)
        flow.rules.thinned(share, len(data), len(out))

    async def _send(self, flow: _Flow, data: bytes, shrink: _Shrink | None) -> bytes:
        out: bytes = data if shrink is None else await asyncio.to_thread(shrink, data)
        flow.sent(out)
        flow.publisher.publish_bytes(out)
        return out

    def statistics(self) -> str:
        """Messages and bytes of each topic, in and out."""
        return "; ".join(
            f"{topic}: {flow.passed} of {flow.came} messages, "
            f"{flow.bytes_out} of {flow.bytes_in} bytes"
            for topic, flow in self.flows.items()
        )


class _BridgeActuator(Actuator):
    """Quality, voxels and application rate of the bridge's topics."""

    name: ClassVar[str] = "compression"

    def __init__(self, bridge: TopicBridge) -> None:
        self._bridge = bridge

    def apply(self, link_id: str, rnti: int | None, strategy: Strategy) -> Applied:  # noqa: ARG002
        return Applied(True, self._bridge.take_strategy(strategy))


def _is_jpeg_heard(flow: _Flow) -> bool:
    return flow.jpeg is not None and flow.jpeg.subscriber_count > 0


def _told(flow: _Flow) -> str:
    rate_bps = flow.rules.budget.rate_bps
    form = f"JPEG {flow.rules.ladder.quality}" if flow.jpeg else "raw"
    return form if math.isinf(rate_bps) else f"{form}, {rate_bps / 1e6:.2f} Mbit/s"


def _plain_scale(treatment: Treatment) -> float:
    """Without JPEG a ratio can only be reached with fewer pixels."""
    return max(5.0, min(treatment.scale, 100 * math.sqrt(treatment.ratio)))


def _jpeg(data: bytes, look: Look) -> bytes | None:
    smaller = to_jpeg(Image.FromString(data), look.scale, look.quality)
    return None if smaller is None else smaller.SerializeToString()


def _smaller_image(data: bytes, scale: float) -> bytes:
    smaller = scaled(Image.FromString(data), scale)
    return data if smaller is None else smaller.SerializeToString()


def _smaller_cloud(data: bytes, leaf_m: float) -> bytes:
    smaller = voxels(PointCloud2.FromString(data), leaf_m)
    return data if smaller is None else smaller.SerializeToString()

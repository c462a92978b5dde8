"""The controller of a turtle as a node: drives it along a circle, judges itself, does what it is asked to.

Nothing in it knows of networks: it subscribes ``turtle1/pose`` and publishes ``turtle1/cmd_vel`` with a tag.
"""

from __future__ import annotations

import asyncio
import logging
from typing import ClassVar

from simple_ros.engine import Engine
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.turtlesim_msgs import AdaptationRequest, ControlStatus, Mos, Pose
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import SENSOR_DATA, QosProfile
from simple_ros.timers import Timer
from simple_ros_engines.network_exposure.mos.estimator import Estimator
from simple_ros_engines.network_exposure.mos.node import MOS_TOPIC
from simple_ros_engines.network_exposure.turtlesim.adaptation import (
    ADAPTATION_TOPIC,
    Adaptations,
    is_meant,
)
from simple_ros_engines.network_exposure.turtlesim.circle import Circle, CircleController
from simple_ros_engines.network_exposure.turtlesim.node import TAG

__all__ = ["TurtleController"]

logger = logging.getLogger(__name__)

_TELL_S = 0.5
_ENOUGH_S = 1.5


class TurtleController(Engine):
    """Drives one turtle.

    Parameters of its node: ``turtle``, ``tag`` (of the commands; empty without a relay), ``rate`` (commands a
    second), ``speed`` (m/s), ``centre_x``, ``centre_y``, ``radius`` (m), ``tolerance`` (m, error at which half of the
    score is lost), ``group`` (under which it judges itself; empty takes the turtle's name).

    Attributes:
        controller: The loop.
        rate_factor: Of the rate, in force now.
    """

    node_name: ClassVar[str] = "turtle_controller"
    summary: ClassVar[str] = "Drives a turtle along a circle and estimates its score."

    def __init__(self) -> None:
        self.controller = CircleController(Circle(5.544, 5.544, 2.0))
        self.rate_factor = 1.0
        self._estimator = Estimator()
        self._turtle = "turtle1"
        self._group = ""
        self._rate_hz = 20.0
        self._timer: Timer | None = None
        self._adaptations = Adaptations()

    @property
    def topics(self) -> tuple[str, str]:
        """What the loop consists of, as relayed."""
        return f"{self._turtle}/pose", f"{self._turtle}/cmd_vel"

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends."""
        get = node.declare_parameter
        self._turtle = str(await get("~turtle", "turtle1", read_only=True))
        tag = str(await get("~tag", TAG, read_only=True))
        self._rate_hz = float(await get("~rate", 20.0, minimum=0.5, maximum=500, read_only=True))
        speed = float(await get("~speed", 1.0, minimum=0.01, maximum=10, read_only=True))
        x = float(await get("~centre_x", 5.544, read_only=True))
        y = float(await get("~centre_y", 5.544, read_only=True))
        radius = float(await get("~radius", 2.0, minimum=0.1, maximum=5, read_only=True))
        tolerance = float(await get("~tolerance", 0.15, minimum=0.001, read_only=True))
        self._group = str(await get("~group", "", read_only=True)) or self._turtle
        self.controller = CircleController(Circle(x, y, radius), speed)
        self._estimator = Estimator(tolerance)
        pose, command = self.topics
        await node.subscribe(pose, Pose, self._pose_came, qos=SENSOR_DATA)
        await node.subscribe(ADAPTATION_TOPIC, AdaptationRequest, self.adapt)
        commands = await node.advertise(f"{command}{tag}", Twist, qos=QosProfile(depth=1))
        status = await node.advertise(
            f"{self._turtle}/control_status", ControlStatus, qos=QosProfile(depth=10)
        )
        scores = await node.advertise(MOS_TOPIC, Mos, qos=QosProfile(depth=10))
        self._timer = node.create_timer(1 / self._rate_hz, lambda _: self._drive(commands))
        node.create_timer(_TELL_S, lambda _: self._tell(status, scores))
        await node.spin()

    def _pose_came(self, pose: Pose) -> None:
        self.controller.pose_came(pose.x, pose.y, pose.theta, _now_s())

    def _drive(self, publisher: Publisher[Twist]) -> None:
        command = self.controller.command(_now_s())
        message = Twist()
        message.linear.x = command.linear
        message.angular.z = command.angular
        publisher.publish(message)

    def adapt(self, request: AdaptationRequest) -> None:
        """Do what the network asks for, if this application is meant."""
        now_s = _now_s()
        if not is_meant(request.group, request.topics, self._group, self.topics):
            return
        if not self._adaptations.came(
            request.requester,
            request.speed_factor,
            request.rate_factor,
            request.valid_s,
            now_s,
            request.reason,
        ):
            logger.warning("a request to adapt makes no sense: %s", request)
        self._obey(now_s)

    def _obey(self, now_s: float) -> None:
        """Drive as is asked for now; requests end by themselves, too."""
        speed, rate = self._adaptations.speed(now_s), self._adaptations.rate(now_s)
        if (speed, rate) == (self.controller.factor, self.rate_factor):
            return
        self.controller.factor, self.rate_factor = speed, rate
        if self._timer is not None:
            self._timer.period = 1 / (self._rate_hz * rate)
        logger.info(
            "%s drives at %g of its speed and %g of its rate now: %s",
            self._turtle,
            speed,
            rate,
            self._adaptations.reason(now_s) or "nobody asks for less",
        )

    def _tell(self, publisher: Publisher[ControlStatus], scores: Publisher[Mos]) -> None:
        self._obey(_now_s())
        tracking, wanted = self.controller.tracking(_now_s()), self.controller.speed
        mos = 0.0
        if tracking.span_s >= _ENOUGH_S:
            mos = self._estimator.score(
                tracking.error_m, tracking.progress_mps, wanted, tracking.pose_age_s
            )
            score = Mos(
                identifier=Mos.AUTOMATIC,
                group=self._group,
                topics=self.topics,
                score=mos,
                detail=f"{tracking.error_m:.3f} m off, {tracking.progress_mps:.2f} m/s",
            )
            score.header.stamp.GetCurrentTime()
            scores.publish(score)
        status = ControlStatus(
            turtle=self._turtle,
            tracking_error=tracking.error_m,
            progress=tracking.progress_mps,
            wanted_speed=wanted,
            speed_factor=self.controller.factor,
            control_rate=self._rate_hz * self.rate_factor,
            pose_age=tracking.pose_age_s,
            mos=mos,
        )
        status.header.stamp.GetCurrentTime()
        publisher.publish(status)


def _now_s() -> float:
    return asyncio.get_running_loop().time()

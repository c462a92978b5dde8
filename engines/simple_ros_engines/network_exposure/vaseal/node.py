"""The VASEAL Service Server as a node: what applications expose goes to the network, what it asks of them to their topic."""

from __future__ import annotations

import asyncio
import logging
from typing import ClassVar

from simple_ros.engine import Engine
from simple_ros.msg.network_exposure_msgs import FlowQosArray
from simple_ros.msg.turtlesim_msgs import AdaptationRequest, Mos
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import LATCHED, QosProfile
from simple_ros_engines.network_exposure.exposure.api import ApiClient
from simple_ros_engines.network_exposure.exposure.http import StandardTransport, client_tls
from simple_ros_engines.network_exposure.mos.node import MOS_TOPIC, judge_of
from simple_ros_engines.network_exposure.turtlesim.adaptation import ADAPTATION_TOPIC
from simple_ros_engines.network_exposure.vaseal.bodies import Wish
from simple_ros_engines.network_exposure.vaseal.exposed import Exposed, FlowState
from simple_ros_engines.network_exposure.vaseal.network_client import NetworkClient
from simple_ros_engines.network_exposure.watcher_settings import connection, receiver_of

__all__ = ["VasealServer"]

logger = logging.getLogger(__name__)

REQUESTER = "network"
_LEASE = 5
"""A report counts for so many periods."""


class VasealServer(Engine):
    """Exposes applications to the network.

    Event monitoring: scores on ``/MOS``, states on ``/network_flow_state`` and requests on
    ``/application_adaptation_request`` are told to the network. Resource management: what the network asks of an
    application is published on ``/application_adaptation_request``, no slower than ``least_factor`` and no longer than
    ``longest_s``. Further parameters of its node: ``period_s`` (of reports), and those of the topic watcher that say how
    the network is reached.

    Attributes:
        exposed: What is known of applications.
    """

    node_name: ClassVar[str] = "vaseal_server"
    summary: ClassVar[str] = "Tells the network how applications are, asks them what it asks for."

    def __init__(self) -> None:
        self.exposed = Exposed()
        self._requests: Publisher[AdaptationRequest] | None = None

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends.

        Raises:
            ConfigError: A parameter makes no sense, or a file is missing.
            OSError: What the network asks cannot be received where the parameters say.
        """
        get = node.declare_parameter
        wiring = await connection(node)
        period_s = float(await get("~period_s", 2.0, minimum=0.2, maximum=60, read_only=True))
        least = float(await get("~least_factor", 0.25, minimum=0.05, maximum=1, read_only=True))
        longest_s = float(await get("~longest_s", 60.0, minimum=1, maximum=3600, read_only=True))
        receiver = receiver_of(wiring)
        await receiver.start(wiring.notify_host, wiring.notify_port)
        try:
            tls = client_tls(wiring.ca_file, wiring.cert_file, wiring.key_file)
            api = ApiClient(
                wiring.url, StandardTransport(tls), wiring.credentials, timeout_s=wiring.timeout_s
            )
            network = NetworkClient(api, receiver, self._wished, least=least, longest_s=longest_s)
            await self._open(node)
            telling = asyncio.create_task(self._tell(network, period_s))
            try:
                await node.spin()
            finally:
                telling.cancel()
                await asyncio.gather(telling, return_exceptions=True)
                await network.close()
        finally:
            await receiver.close()

    async def _open(self, node: NodeHandle) -> None:
        deep = QosProfile(depth=10)
        self._requests = await node.advertise(ADAPTATION_TOPIC, AdaptationRequest, qos=deep)
        await node.subscribe(ADAPTATION_TOPIC, AdaptationRequest, self._asked, qos=deep)
        await node.subscribe(MOS_TOPIC, Mos, self._scored)
        await node.subscribe("/network_flow_state", FlowQosArray, self._flows_came, qos=LATCHED)

    async def _tell(self, network: NetworkClient, period_s: float) -> None:
        valid_s = max(1.0, _LEASE * period_s)
        while True:
            await network.tell(self.exposed.reports(_now_s(), valid_s))
            await asyncio.sleep(period_s)

    # -- what applications say ---------------------------------------------------------------------

    def _scored(self, message: Mos) -> None:
        judge = judge_of(message)
        if judge is not None:
            self.exposed.scored(message.group, message.topics, message.score, judge, _now_s())

    def _flows_came(self, message: FlowQosArray) -> None:
        self.exposed.flows_are(
            FlowState(flow.topic.strip("/"), flow.state, flow.qci, flow.applied_qci)
            for flow in message.flows
        )

    def _asked(self, message: AdaptationRequest) -> None:
        factors = (message.speed_factor, message.rate_factor)
        self.exposed.asked(
            message.group,
            tuple(message.topics),
            message.requester,
            factors,
            message.valid_s,
            _now_s(),
        )

    # -- what the network says ---------------------------------------------------------------------

    def _wished(self, group: str, wish: Wish) -> None:
        if self._requests is None:
            return
        logger.info("the network asks %s for %g of its speed", group, wish.speed)
        request = AdaptationRequest(
            group=group,
            topics=self.exposed.groups(_now_s()).get(group, ()),
            speed_factor=wish.speed,
            rate_factor=wish.rate,
            reason=wish.reason or "the network asks",
            requester=REQUESTER,
            valid_s=wish.valid_s,
        )
        request.header.stamp.GetCurrentTime()
        self._requests.publish(request)


def _now_s() -> float:
    return asyncio.get_running_loop().time()

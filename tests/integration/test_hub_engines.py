"""What the hub says, and an engine that hears it: grants, policies, and modes that somebody chose."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Callable

import pytest
from support.engines import at_work, user
from support.waiting import LIMIT_S, until

from simple_ros.aio import NodeHandle
from simple_ros.msg.wireless_ros_msgs import (
    Constraint,
    PhyLayerMetrics,
    RefusedLink,
    ResourceGrant,
    ResourceGrants,
    TransmissionStrategy,
)
from simple_ros.publisher import Publisher
from simple_ros.qos import LATCHED
from simple_ros_engines.cross_domain.node import CrossDomainEngine
from simple_ros_engines.physical_adaptive.node import PhysicalAdaptiveEngine
from simple_ros_hub.steering import Steering
from simple_ros_master import Master


class Chain:
    """What comes before and after the physical engine."""

    def __init__(self, node: NodeHandle) -> None:
        self.node = node
        self.strategies: list[TransmissionStrategy] = []
        self._seq = 0

    async def open(self) -> None:
        advertise = self.node.advertise
        self._metrics: Publisher[PhyLayerMetrics] = await advertise(
            "/wireless_ros/phy_layer_metrics", PhyLayerMetrics
        )
        self._constraints: Publisher[Constraint] = await advertise(
            "/wireless_ros/constraints", Constraint
        )
        self.grants: Publisher[ResourceGrants] = await advertise(
            "/wireless_ros/resource_grants", ResourceGrants, qos=LATCHED
        )
        subscriber = await self.node.subscribe(
            "/wireless_ros/transmission_strategy", TransmissionStrategy, self.strategies.append
        )
        for publisher in (self._metrics, self._constraints, self.grants):
            await publisher.wait_for_subscribers(1, timeout=30)
        # A strategy that is told before the engine knows of us does not come.
        while not subscriber.publisher_count:
            self._tell()
            with contextlib.suppress(AssertionError):
                await until(lambda: subscriber.publisher_count, limit=0.2)

    async def strategy(self) -> TransmissionStrategy:
        """What the engine makes of a link that 20 Mbit/s shall go over; from no loss it learns nothing."""
        count = len(self.strategies)
        self._tell()
        await until(lambda: len(self.strategies) > count, "a strategy")
        return self.strategies[-1]

    def _tell(self) -> None:
        self._seq += 1
        metrics = PhyLayerMetrics(link_id="x", snr_db=11.5, mcs=10, channel_capacity=4)
        metrics.header.seq = self._seq
        self._metrics.publish(metrics)
        constraint = Constraint(link_id="x", max_data_rate=20, constraint_type="STANDARD")
        constraint.header.seq = self._seq
        self._constraints.publish(constraint)

    async def becomes(
        self, wanted: Callable[[TransmissionStrategy], bool], what: str
    ) -> TransmissionStrategy:
        """Ask until a strategy is so: what was said before goes another way than metrics do."""
        end = time.monotonic() + LIMIT_S
        while not wanted(newest := await self.strategy()):
            assert time.monotonic() < end, f"{what}: {newest}"
            await asyncio.sleep(0.005)
        return newest


@pytest.fixture
async def chain(master: Master) -> AsyncIterator[Chain]:
    quiet = {"use_reinforcement_learning": False}
    async with at_work(PhysicalAdaptiveEngine(), master, **quiet), user(master) as node:
        made = Chain(node)
        await made.open()
        yield made


def granted(prb: int, mbps: float) -> ResourceGrants:
    grant = ResourceGrant(link_id="x", requested_prb=40, requested_bps=20e6)
    grant.granted_prb, grant.granted_bps = prb, mbps * 1e6
    return ResourceGrants(grants=[grant])


async def test_a_strategy_keeps_to_its_grant(chain: Chain) -> None:
    free = await chain.strategy()
    assert free.target_prb > 10
    assert free.compression_ratio == pytest.approx(1.0)
    chain.grants.publish(granted(6, 20))
    narrow = await chain.becomes(lambda said: said.target_prb == 6, "few blocks")
    assert narrow.compression_ratio < 0.5
    chain.grants.publish(granted(40, 5))
    await chain.becomes(lambda said: said.rate_bps == pytest.approx(5e6), "a low rate")
    chain.grants.publish(ResourceGrants(refused=[RefusedLink(link_id="x", reason="full")]))
    await chain.becomes(lambda said: said.target_prb == 0, "nothing")
    # Who got what it wished for is not held to what it wished half a second ago.
    chain.grants.publish(granted(40, 20))
    await chain.becomes(lambda said: said.target_prb == free.target_prb, "all")


async def test_another_target_error_rate_counts_at_once(chain: Chain) -> None:
    target = "/wireless_ros/physical_adaptive_engine/target_bler"
    bold = await chain.strategy()
    await chain.node.set_parameters({target: 1e-6})
    await chain.becomes(lambda said: said.target_mcs < bold.target_mcs, "fewer errors")
    await chain.node.set_parameters({target: 0.1})
    await chain.becomes(lambda said: said.target_mcs == bold.target_mcs, "as before")


async def test_a_mode_that_somebody_chose_outlives_policies(master: Master) -> None:
    engine, mode = ["cross_domain_engine"], "/wireless_ros/cross_domain_engine/mode"
    async with at_work(CrossDomainEngine(), master) as node, user(master) as person:
        steering = Steering(person, {}, lambda _, __: None)

        async def applied(policy: str) -> str:
            assert await steering.apply(policy, engine)
            return str(await person.get_parameter(mode))

        await until(lambda: "~mode" in node.parameters, "an engine")
        await person.set_parameters({mode: "burst"})
        assert await applied("PERFORMANCE_FOCUS") == "burst"
        assert await applied("HIGH_EFFICIENCY") == "optimized"
        assert await applied("BALANCED_OPERATION") == "burst"
        assert await applied("HIGH_EFFICIENCY") == "optimized"
        await person.set_parameters({mode: "realtime"})
        assert await applied("CONGESTION_CONTROL") == "optimized"
        assert await applied("BALANCED_OPERATION") == "realtime"

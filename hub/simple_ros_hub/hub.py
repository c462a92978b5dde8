"""The hub as a node: carries what the pure parts decide to processes, topics and parameters."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros.msg.wireless_ros_msgs import EngineStatus
from simple_ros.node import NodeHandle
from simple_ros_engines.modes import IntervalControl
from simple_ros_hub.components import NAMESPACE, Component, Kind, components_of
from simple_ros_hub.conditions import Action, Do, Phase, State
from simple_ros_hub.coordination import Coordinator, Shared
from simple_ros_hub.dashboard import Dashboard
from simple_ros_hub.degradation import DegradationJudge
from simple_ros_hub.journal import CALM_S, Journal
from simple_ros_hub.keeper import ProcessKeeper
from simple_ros_hub.outlets import Outlets
from simple_ros_hub.place import Place
from simple_ros_hub.policy import PolicyKeeper
from simple_ros_hub.report import event_message
from simple_ros_hub.reporting import Reporter
from simple_ros_hub.senses import Senses
from simple_ros_hub.services import HubServices
from simple_ros_hub.settings import LIVE_LIMITS, HubSettings, declare_settings, resource_limits
from simple_ros_hub.steering import Steering
from simple_ros_hub.supervision import Supervision

__all__ = ["NODE_NAME", "Hub"]

logger = logging.getLogger(__name__)

NODE_NAME = f"/{NAMESPACE}/hub"
_TICK_S = 0.1
_JUDGE_S = 0.25
_DOWN_S = 5.0
_REFUSED = "refused "


class Hub:
    """Supervises, shares out, decides and reports. Use `run`.

    Args:
        node: Started.
        place: The hub's directory.
        components: What to look after.
        leave_running: Whether components run on when the hub is asked to end.
        dashboard: Host and port of the page; None for none.
    """

    def __init__(
        self,
        node: NodeHandle,
        place: Place,
        components: Sequence[Component],
        *,
        leave_running: bool = False,
        dashboard: tuple[str, int] | None = None,
    ) -> None:
        self.node = node
        self.place = place
        self.components = {item.name: item for item in components}
        self.journal = Journal()
        self.coordinator = Coordinator()
        self.degradation = DegradationJudge()
        self.policy = PolicyKeeper()
        self.settings = HubSettings()
        self.supervision = Supervision(())
        self.services = HubServices(self)
        self.keeper = ProcessKeeper(place.directory, self._process_ended, node.master)
        self.shared: Shared | None = None
        self.outlets: Outlets | None = None
        self.load = 0.0
        self.work_ms: tuple[float, float] = (0.0, 0.0)
        self._leave_running = leave_running
        self._dashboard = None if dashboard is None else Dashboard(self, *dashboard)
        self._stops: set[asyncio.Task[None]] = set()
        self._spent_s: list[float] = []
        self._steered = ""
        self._down_since_s: dict[str, float] = {}

    async def run(self) -> None:
        """Work until cancelled or the node ends.

        If the hub itself fails, the components run on, for the next hub to take over.
        """
        leave_running = True
        try:
            await self._set_up()
            await self._work()
            leave_running = self._leave_running
        except asyncio.CancelledError:
            leave_running = self._leave_running
            raise
        finally:
            await self.keeper.close(leave_running=leave_running)

    async def _work(self) -> None:
        try:
            async with asyncio.TaskGroup() as group:
                tasks = [group.create_task(work) for work in self._loops()]
                await self.node.spin()
                for task in tasks:
                    task.cancel()
        except BaseExceptionGroup as errors:
            raise errors.exceptions[0] from None

    # -- start ---------------------------------------------------------------------------------

    async def _set_up(self) -> None:
        self.settings = await declare_settings(self.node)
        await self._add_from_master()
        self.supervision = Supervision(tuple(self.components.values()), self.settings.supervision)
        self.supervision.begin(time.monotonic())
        self._take_limits()
        for name in LIVE_LIMITS:
            self.node.on_parameter_changed(f"~{name}", lambda _: self._take_limits())
        self.outlets = await Outlets.open(self.node)
        self.reporter = Reporter(self, self.outlets)
        self._remember_policy()
        self.senses = Senses(self.node, self.coordinator, self._heard, self.settings.flow_period_s)
        await self.senses.open()
        for name, pid in self.keeper.recover(self.components).items():
            self.supervision.found(name, pid, time.monotonic())
        self.supervision.discovered()
        await self.services.open()
        self._tell_policy(self.policy.policy, "as before" if self.policy.pinned else "initial")
        self._tell_degradation()
        self._settle()

    async def _add_from_master(self) -> None:
        """Components that parameters of this node describe: ``~components/NAME/...``."""
        said = await self.node.get_parameter("~components", {})
        try:
            added = components_of({"components": said}, f"{NODE_NAME}/components") if said else ()
        except ConfigError as error:
            self.log_error(str(error))
            return
        for component in added:
            self.components.setdefault(component.name, component)

    def _remember_policy(self) -> None:
        before = self.place.remembered()
        dwell_s = self.settings.policy_dwell_s
        self.policy = PolicyKeeper(dwell_s)
        try:
            if before.get("policy"):
                self.policy.pin(str(before["policy"]), time.monotonic())
                self.policy.pinned = bool(before.get("pinned"))
        except ConfigError:
            logger.warning("the policy %r of an earlier hub is unknown", before["policy"])
        base = before.get("base")
        self.steering = Steering(
            self.node, base if isinstance(base, dict) else {}, self._steering_trouble
        )

    def _take_limits(self) -> None:
        self.coordinator.set_limits(resource_limits(self.node))
        managed = bool(self.node.parameters["~priority_management_enabled"])
        self.coordinator.manages_priorities = managed

    # -- what goes on --------------------------------------------------------------------------

    def _loops(self) -> list[Coroutine[Any, Any, None]]:
        settings = self.settings
        page = [] if self._dashboard is None else [self._dashboard.run()]
        return [
            *page,
            self._every(_TICK_S, self._tick, stretches=False),
            self._every(settings.resource_interval_s, self._share),
            self._every(settings.check_interval_s, self._report),
            self._every(_JUDGE_S, self._judge, stretches=False),
            self._every(settings.optimization_interval_s, self._optimize),
            self._steer(),
        ]

    async def _every(
        self, interval_s: float, work: Callable[[], None], *, stretches: bool = True
    ) -> None:
        """Do a piece of work again and again; less often while it takes most of the time.

        What it raises is logged, and it goes on.
        """
        control = IntervalControl(interval_s)
        while True:
            begun = time.perf_counter()
            try:
                work()
            except Exception as error:
                self.log_error(f"Error in {work.__name__.strip('_')}: {error!r}")
                logger.exception("the hub's %s failed", work.__name__)
            took_s = time.perf_counter() - begun
            self._spent_s.append(took_s)
            await asyncio.sleep(control.worked(took_s) if stretches else interval_s)

    def _tick(self) -> None:
        self.supervision.tick(time.monotonic())
        self._settle()

    def _share(self) -> None:
        now_s = time.monotonic()
        shared = self.coordinator.share(now_s)
        before, self.shared = self.shared, shared
        blocks = shared.blocks
        self.reporter.tell_grants(shared, changed=before is None or before != shared)
        conflict = f"PRB allocation conflict detected: {blocks.requested}/{blocks.total}"
        self._condition(
            "conflict", conflict if blocks.is_conflict else "", "PRB allocation conflict is over"
        )
        floors = f"the floors do not fit {blocks.total} blocks and were scaled"
        self._condition("floors", floors if blocks.floors_scaled else "", "the floors fit again")
        told = {
            name.removeprefix(_REFUSED)
            for name in self.journal.present
            if name.startswith(_REFUSED)
        }
        for key in told | shared.refused.keys():
            reason = shared.refused.get(key)
            text = f"link {key} is refused: {reason}" if reason else ""
            self._condition(f"{_REFUSED}{key}", text, f"link {key} is admitted, or gone")

    def _judge(self) -> None:
        now_s = time.monotonic()
        strain = self.coordinator.strain(now_s, self._down(now_s), self.load)
        if self.degradation.update(strain, now_s):
            level = self.degradation.level.name
            self.log_event(f"Degradation level {level}: {self.degradation.reason}")
            self._tell_degradation()

    def _down(self, now_s: float) -> tuple[str, ...]:
        """Required engines that have not worked for a while: a restart is no reason to give things up."""
        if self.supervision.phase is not Phase.OPERATION:
            return ()
        down = [
            view.component.name
            for view in self.supervision.views()
            if view.component.kind is Kind.ENGINE and view.component.required and not view.works
        ]
        self._down_since_s = {name: self._down_since_s.get(name, now_s) for name in down}
        return tuple(n for n, since_s in self._down_since_s.items() if now_s - since_s >= _DOWN_S)

    def _report(self) -> None:
        spent, self._spent_s = self._spent_s, []
        self.load = min(1.0, sum(spent) / self.settings.check_interval_s)
        if spent:
            self.work_ms = (1000 * sum(spent) / len(spent), 1000 * max(spent))
        for key, text in self.senses.look(self._telling()):
            self._condition(key, text, f"{key} flows well again")
        self.reporter.report()

    def _optimize(self) -> None:
        now_s = time.monotonic()
        if not self.coordinator.has_data(now_s):
            return
        decision = self.policy.update(self.coordinator.situation(now_s), now_s)
        if decision is not None:
            self.policy_changed(decision.policy, decision.reason)

    def policy_changed(self, policy: str, reason: str) -> None:
        """Tell everybody of a new policy, and have it applied."""
        self.log_event(f"Global Policy Updated: {policy}")
        self._tell_policy(policy, reason)

    def _tell_policy(self, policy: str, reason: str) -> None:
        self.reporter.tell_policy(policy, reason)
        self._steered = ""
        self.remember()

    async def _steer(self) -> None:
        """Have the policy applied, also by engines that were started later."""
        told: dict[str, int] = {}
        while True:
            working = {
                view.component.name: view.restarts
                for view in self.supervision.views()
                if view.component.kind is Kind.ENGINE and view.works
            }
            if self._steered != self.policy.policy or told != working:
                policy = self.policy.policy
                if await self.steering.apply(policy, list(working)):
                    self._steered, told = policy, working
                    self.remember()
            await asyncio.sleep(0.25)

    def remember(self) -> None:
        """Keep for a later hub what it cannot find out."""
        self.place.remember(
            {
                "policy": self.policy.policy,
                "pinned": self.policy.pinned,
                "base": self.steering.base,
            }
        )

    # -- processes -----------------------------------------------------------------------------

    def _settle(self) -> None:
        """Carry out what supervision has decided."""
        for action in self.supervision.take_actions():
            self._carry_out(action)
        for happening in self.supervision.take_happenings():
            if happening.is_error:
                self.log_error(happening.text, happening.component)
            else:
                self.log_event(happening.text, happening.component)

    def settle(self) -> None:
        """The same, for services."""
        self._settle()

    def _carry_out(self, action: Action) -> None:
        now_s = time.monotonic()
        match action.do:
            case Do.START:
                try:
                    pid = self.keeper.start(self.supervision.view(action.name).component)
                except OSError as error:
                    self.supervision.ended(action.name, f"cannot be started: {error}", now_s)
                else:
                    self.supervision.started(action.name, pid, now_s)
                    self.senses.began(action.name)
            case Do.KILL:
                self.keeper.kill(action.name)
            case Do.STOP:
                task = asyncio.create_task(self.keeper.stop(action.name))
                self._stops.add(task)
                task.add_done_callback(self._stops.discard)

    def _process_ended(self, name: str, how: str) -> None:
        self.supervision.ended(name, how, time.monotonic())
        self._settle()

    def _heard(self, name: str, status: EngineStatus) -> None:
        self.supervision.heard(name, status.state, status.detail, time.monotonic())

    def _telling(self) -> set[str]:
        """Components that ought to have something to tell: a degraded one may have nothing."""
        views = self.supervision.views()
        return {view.component.name for view in views if view.state is State.ACTIVE}

    # -- log -----------------------------------------------------------------------------------

    def log_event(self, text: str, component: str = "") -> None:
        """Something happened."""
        self.journal.log_system_event(text, self._stamp(), component)
        logger.info("System Event: %s", text)
        self._publish_events()

    def log_error(self, text: str, component: str = "") -> None:
        """Something bad happened."""
        self.journal.log_error(text, self._stamp(), component)
        logger.error("%s", text)
        self._publish_events()

    def _condition(self, key: str, text: str, over: str, calm_s: float = CALM_S) -> None:
        entry = self.journal.condition(key, text, self._stamp(), over=over, calm_s=calm_s)
        if entry is not None:
            logger.log(logging.WARNING if entry.is_error else logging.INFO, "%s", entry.text)
            self._publish_events()

    def _steering_trouble(self, engine: str, text: str) -> None:
        # Told once each, so there is nothing to wait for.
        self._condition(f"steering {engine}", text, f"{engine} takes the policy again", 0.0)

    def _publish_events(self) -> None:
        if self.outlets is not None:
            for entry in self.journal.take_fresh():
                self.outlets.events.publish(event_message(entry))

    def _tell_degradation(self) -> None:
        self.reporter.tell_degradation()

    def _stamp(self) -> int:
        return self.node.clock.now().nanoseconds

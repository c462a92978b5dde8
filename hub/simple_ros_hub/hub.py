"""The hub as a node: carries what the pure parts decide to processes, topics and parameters."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros.msg.std_msgs import String
from simple_ros.msg.wireless_ros_msgs import EngineStatus
from simple_ros.node import NodeHandle
from simple_ros_engines.modes import IntervalControl
from simple_ros_hub.chronicle import Chronicle
from simple_ros_hub.components import NAMESPACE, Component, Kind, components_of
from simple_ros_hub.conditions import Action, Do, Phase, State
from simple_ros_hub.coordination import Coordinator, Shared
from simple_ros_hub.degradation import DegradationJudge
from simple_ros_hub.event_log import EventLog
from simple_ros_hub.journal import CALM_S
from simple_ros_hub.keeper import ProcessKeeper
from simple_ros_hub.outlets import Outlets
from simple_ros_hub.place import Place
from simple_ros_hub.policy import PolicyKeeper
from simple_ros_hub.recollection import Recollection
from simple_ros_hub.report import event_message
from simple_ros_hub.reporting import Reporter
from simple_ros_hub.routes import RouteJudge
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
_LOOK_FOR_MASTER_S = 0.5
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
        self.chronicle = Chronicle(EventLog(place.directory), self._stamp)
        self.journal = self.chronicle.journal
        self.coordinator = Coordinator()
        self.degradation = DegradationJudge()
        self.policy = PolicyKeeper()
        self.routes: RouteJudge | None = None
        self.settings = HubSettings()
        self.supervision = Supervision(())
        self.services = HubServices(self)
        self.recollection = Recollection(self)
        self.keeper = ProcessKeeper(place.directory, self._process_ended, node.master)
        self.shared: Shared | None = None
        self.outlets: Outlets | None = None
        self.load = 0.0
        self.work_ms: tuple[float, float] = (0.0, 0.0)
        self._leave_running = leave_running
        self._page = dashboard
        self._stops: set[asyncio.Task[None]] = set()
        self._spent_s: list[float] = []
        self._steered = ""
        self._down_since_s: dict[str, float] = {}
        self._is_ending = False
        self.steering = Steering(node, {}, self.steering_trouble)

    async def run(self) -> None:
        """Work until cancelled or the node ends.

        If the hub itself fails, the components run on, for the next hub to take over.
        """
        in_order, leave_running = False, True
        try:
            await self._set_up()
            await self._work()
            in_order, leave_running = True, self._leave_running
        except asyncio.CancelledError:
            in_order, leave_running = True, self._leave_running
            raise
        finally:
            self._is_ending = True
            if in_order:
                # Only into the log: the node may have ended.
                self.chronicle.log_event(
                    "The hub ends, components run on" if leave_running else "The hub ends"
                )
            await self.keeper.close(leave_running=leave_running)
            if in_order:
                self.recollection.ended(leave_running=leave_running)

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
        before = self.recollection.recall()
        # First what is ours: signs of life that come before would count as strangers'.
        all_known = self.recollection.take_over(before)
        self.senses = Senses(
            self.node,
            self.coordinator,
            self._heard,
            self.settings.flow_period_s,
            self.components.keys(),
        )
        await self.senses.open()
        self.supervision.discovered(all_known=all_known)
        await self.services.open()
        self._tell_policy(self.policy.policy, "as before" if self.policy.pinned else "initial")
        self._tell_degradation()
        self._tell_route()
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

    def _take_limits(self) -> None:
        self.coordinator.set_limits(resource_limits(self.node))
        managed = bool(self.node.parameters["~priority_management_enabled"])
        self.coordinator.manages_priorities = managed

    async def _serve(self, host: str, port: int) -> None:
        # It takes numpy and a web server along: a hub without a page is back sooner after its death.
        from simple_ros_hub.dashboard import Dashboard

        await Dashboard(self, host, port).run()

    # -- what goes on --------------------------------------------------------------------------

    def _loops(self) -> list[Coroutine[Any, Any, None]]:
        settings = self.settings
        page = [] if self._page is None else [self._serve(*self._page)]
        return [
            *page,
            self._every(_TICK_S, self._tick, stretches=False),
            self._every(settings.resource_interval_s, self._share),
            self._every(settings.check_interval_s, self._report),
            self._every(_JUDGE_S, self._judge, stretches=False),
            self._every(settings.optimization_interval_s, self._optimize),
            self._steer(),
            self._watch_master(),
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
        self.condition(
            "conflict", conflict if blocks.is_conflict else "", "PRB allocation conflict is over"
        )
        floors = f"the floors do not fit {blocks.total} blocks and were scaled"
        self.condition("floors", floors if blocks.floors_scaled else "", "the floors fit again")
        told = {
            name.removeprefix(_REFUSED)
            for name in self.journal.present
            if name.startswith(_REFUSED)
        }
        for key in told | shared.refused.keys():
            reason = shared.refused.get(key)
            text = f"link {key} is refused: {reason}" if reason else ""
            self.condition(f"{_REFUSED}{key}", text, f"link {key} is admitted, or gone")

    def _judge(self) -> None:
        now_s = time.monotonic()
        strain = self.coordinator.strain(now_s, self._down(now_s), self.load)
        if self.degradation.update(strain, now_s):
            level = self.degradation.level.name
            self.log_event(f"Degradation level {level}: {self.degradation.reason}")
            self._tell_degradation()
        self._choose_route(now_s)

    def _choose_route(self, now_s: float) -> None:
        routes = self.routes
        if routes is not None and routes.update(self.coordinator.healths(), now_s):
            self.log_event(f"Route {routes.route} is taken: {routes.reason}")
            self._tell_route()

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
            self.condition(key, text, f"{key} flows well again")
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
        self.recollection.remember()

    async def _watch_master(self) -> None:
        """All goes on without a Master; nobody new finds anybody meanwhile."""
        while True:
            trouble = ""
            try:
                await self.node.wait_for_master(_LOOK_FOR_MASTER_S)
            except TimeoutError:
                trouble = f"the Master at {self.node.master} does not answer"
            self.condition("master", trouble, "the Master answers again", 0.0)
            await asyncio.sleep(_LOOK_FOR_MASTER_S)

    # -- processes -----------------------------------------------------------------------------

    def _settle(self) -> None:
        """Carry out what supervision has decided."""
        for action in self.supervision.take_actions():
            self._carry_out(action)
        # Before anybody hears of it: the next hub must know what this one has told.
        self.remember()
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
        if self._is_ending:
            self.chronicle.log_event(f"Stopped {name}", name)
            return
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
        self.chronicle.log_event(text, component)
        self._publish_events()

    def log_error(self, text: str, component: str = "") -> None:
        """Something bad happened."""
        self.chronicle.log_error(text, component)
        self._publish_events()

    def condition(self, key: str, text: str, over: str, calm_s: float = CALM_S) -> None:
        """Something bad is so, or is not any more: told when it begins and when it ended."""
        self.chronicle.condition(key, text, over, calm_s)
        self._publish_events()

    def steering_trouble(self, engine: str, text: str) -> None:
        """An engine does not take the policy, or takes it again."""
        # Told once each, so there is nothing to wait for.
        self.condition(f"steering {engine}", text, f"{engine} takes the policy again", 0.0)

    def _publish_events(self) -> None:
        # In DISCOVERY those who listened to an earlier hub are just being connected; in the end the node is gone.
        if self._is_ending:
            return
        if self.outlets is not None and self.supervision.phase is not Phase.DISCOVERY:
            for entry in self.chronicle.take_unsent():
                self.outlets.events.publish(event_message(entry))

    def _tell_degradation(self) -> None:
        self.reporter.tell_degradation()

    def _tell_route(self) -> None:
        if self.routes is not None and self.outlets is not None:
            self.outlets.route.publish(String(data=self.routes.route))

    def _stamp(self) -> int:
        return self.node.clock.now().nanoseconds

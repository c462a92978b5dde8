"""The hub's own services."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from simple_ros.errors import ConfigError
from simple_ros.msg.wireless_ros_msgs import (
    ControlComponent,
    ControlComponentRequest,
    ControlComponentResponse,
    GetSystemEvents,
    GetSystemEventsRequest,
    GetSystemEventsResponse,
    SetGlobalPolicy,
    SetGlobalPolicyRequest,
    SetGlobalPolicyResponse,
)
from simple_ros_hub.components import NAMESPACE
from simple_ros_hub.report import event_message

if TYPE_CHECKING:
    from simple_ros_hub.hub import Hub

__all__ = ["HubServices"]


class HubServices:
    """``control_component``, ``set_global_policy`` and ``get_system_events``."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub

    async def open(self) -> None:
        """Provide them."""
        provide = self._hub.node.advertise_service
        await provide(f"/{NAMESPACE}/control_component", ControlComponent, self.control)
        await provide(f"/{NAMESPACE}/set_global_policy", SetGlobalPolicy, self.set_policy)
        await provide(f"/{NAMESPACE}/get_system_events", GetSystemEvents, self._events)

    def control(self, request: ControlComponentRequest) -> ControlComponentResponse:
        """Start, stop or restart a component."""
        supervision = self._hub.supervision
        actions = {
            "start": supervision.start,
            "stop": supervision.stop,
            "restart": supervision.restart,
        }
        action = actions.get(request.action)
        if action is None:
            known = ", ".join(actions)
            return ControlComponentResponse(message=f"{request.action!r} is none of {known}")
        try:
            view = supervision.view(request.name)
        except LookupError as error:
            return ControlComponentResponse(message=str(error.args[0]))
        if view.works and not view.pid and request.action != "start":
            return ControlComponentResponse(
                message=f"{request.name} is not a process of this hub: end it where it was started"
            )
        self._hub.log_event(f"{request.action} of {request.name} was asked for", request.name)
        action(request.name)
        self._hub.settle()
        return ControlComponentResponse(ok=True, message=f"{request.name} is {view.state.value}")

    def set_policy(self, request: SetGlobalPolicyRequest) -> SetGlobalPolicyResponse:
        """Choose a policy, or none."""
        hub = self._hub
        if not request.policy:
            hub.policy.release()
            hub.log_event("The hub chooses the global policy again")
            hub.reporter.tell_policy(hub.policy.policy, "the hub chooses again")
            hub.remember()
            return SetGlobalPolicyResponse(ok=True, policy=hub.policy.policy)
        try:
            decision = hub.policy.pin(request.policy, time.monotonic())
        except ConfigError as error:
            return SetGlobalPolicyResponse(policy=hub.policy.policy, message=str(error))
        hub.remember()
        if decision is not None:
            hub.policy_changed(decision.policy, decision.reason)
        return SetGlobalPolicyResponse(ok=True, policy=hub.policy.policy)

    def _events(self, request: GetSystemEventsRequest) -> GetSystemEventsResponse:
        journal = self._hub.journal
        kept = list(journal.error_logs if request.errors_only else journal.system_events)
        chosen = kept[-request.limit :] if request.limit else kept
        return GetSystemEventsResponse(events=[event_message(entry) for entry in chosen])

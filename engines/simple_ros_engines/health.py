"""Engines in the diagnostics of the system: the topic /diagnostics, as every other component."""

from __future__ import annotations

from typing import Any

from simple_ros.diagnostics import ERROR, OK, WARN, DiagnosticUpdater, Status
from simple_ros.node import NodeHandle

__all__ = ["report_health"]


async def report_health(node: NodeHandle, engine: Any) -> DiagnosticUpdater:
    """Say once a second how an engine is.

    Args:
        node: Its node.
        engine: A `base.WirelessEngine`.
    """
    updater = await DiagnosticUpdater.create(node)
    before = 0

    def look(status: Status) -> None:
        nonlocal before
        if engine.state == "degraded":
            status.summary(WARN, f"Engine degraded: {engine.detail}")
        elif engine.errors > before:
            status.summary(ERROR, f"{engine.errors - before} inputs could not be handled")
        elif engine.state == "starting":
            status.summary(WARN, "Engine starting")
        else:
            status.summary(OK, "Engine running normally")
        before = engine.errors
        status.add("Active RNTIs", engine.link_count())
        status.add("Inputs", engine.processed)
        status.add("Errors", engine.errors)

    updater.add("engine", look)
    return updater

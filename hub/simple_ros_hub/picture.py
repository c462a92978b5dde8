"""What the dashboard shows, as JSON values. Pure."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from simple_ros.msg.nav_msgs import OccupancyGrid
from simple_ros.msg.wireless_ros_msgs import (
    ChannelState,
    ComponentStatus,
    PhyLayerMetrics,
    SystemStatus,
    WirelessPerformance,
)
from simple_ros_hub.coordination import Shared
from simple_ros_hub.journal import Entry

__all__ = ["event_json", "links_json", "map_json", "shares_json", "status_json"]

_MAP_CELLS = 200


def status_json(status: SystemStatus) -> dict[str, Any]:
    """Phase, policy, level, components and performance."""
    return {
        "phase": status.phase,
        "degraded": status.degraded,
        "reasons": list(status.reasons),
        "level": {
            "number": status.degradation.level,
            "name": status.degradation.name,
            "reason": status.degradation.reason,
        },
        "performance": _performance(status.performance),
        "components": [_component(item) for item in status.components],
        "loop_ms": [round(status.loop_ms_mean, 3), round(status.loop_ms_max, 3)],
    }


def _performance(message: WirelessPerformance) -> dict[str, float | str]:
    numbers = {name: round(getattr(message, name), 4) for name in message.known}
    return {**numbers, "counted": message.counted}


def _component(item: ComponentStatus) -> dict[str, Any]:
    return {
        "name": item.name,
        "kind": item.kind,
        "state": item.state,
        "message": item.message,
        "required": item.required,
        "mode": item.mode,
        "pid": item.pid,
        "restarts": item.restarts,
        "heartbeat_s": round(item.heartbeat_age_s, 2),
        "cpu_percent": round(item.cpu_percent, 1),
        "memory_mb": round(item.memory_bytes / 1e6, 1),
        "processed": item.processed,
        "errors": item.errors,
    }


def links_json(
    metrics: Mapping[str, PhyLayerMetrics], channels: Mapping[str, ChannelState]
) -> list[dict[str, Any]]:
    """Each link, by key."""
    found = []
    for key, message in sorted(metrics.items()):
        channel = channels.get(key)
        found.append(
            {
                "link": key,
                "quality": round(message.link_quality, 3),
                "stability": round(message.channel_stability, 3),
                "reliability": round(message.reliability, 3),
                "snr_db": round(message.snr_db, 1) if message.channel_capacity else None,
                "bler": round(message.bler, 4) if message.channel_capacity else None,
                "mcs": message.mcs if message.channel_capacity else None,
                "rtt_ms": round(message.channel_response_time, 1) or None,
                "mbps": round(message.throughput_bps / 1e6, 2),
                "available_mbps": round(message.available_bps / 1e6, 2),
                "source": channel.source if channel is not None else "",
            }
        )
    return found


def shares_json(shared: Shared | None) -> dict[str, Any]:
    """Who may use what."""
    if shared is None:
        return {"total": 0, "requested": 0, "granted": 0, "jain": 1.0, "grants": [], "refused": {}}
    blocks = shared.blocks
    return {
        "total": blocks.total,
        "requested": blocks.requested,
        "granted": blocks.granted,
        "jain": round(blocks.jain, 3),
        "floors_scaled": blocks.floors_scaled,
        "grants": [
            {
                "link": block.key,
                "wanted": block.wanted,
                "granted": block.granted,
                "floor": block.floor,
                "priority": block.priority,
                "mbps": round(rate.granted / 1000, 2),
            }
            for block, rate in zip(blocks.grants, shared.rates.grants, strict=True)
        ],
        "refused": dict(shared.refused),
    }


def event_json(entries: Iterable[Entry]) -> list[dict[str, Any]]:
    """Entries of the journal."""
    return [
        {
            "number": entry.number,
            "time_s": entry.stamp_ns / 1e9,
            "component": entry.component,
            "text": entry.text,
            "is_error": entry.is_error,
        }
        for entry in entries
    ]


def map_json(grid: OccupancyGrid) -> dict[str, Any] | None:
    """A map of at most 200 cells a side; a byte a cell, 0 unknown, else cost + 1. None if it is malformed."""
    width, height = grid.info.width, grid.info.height
    if not width or not height or len(grid.data) != width * height:
        return None
    step = max(1, -(-max(width, height) // _MAP_CELLS))
    cells = np.frombuffer(grid.data, np.int8).reshape(height, width)[::step, ::step]
    data = np.clip(cells.astype(np.int16) + 1, 0, 101).astype(np.uint8)
    origin = grid.info.origin.position
    return {
        "width": data.shape[1],
        "height": data.shape[0],
        "resolution": grid.info.resolution * step,
        "origin": [origin.x, origin.y],
        "cells": base64.b64encode(data.tobytes()).decode(),
    }

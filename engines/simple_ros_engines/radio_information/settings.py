"""Parameters of the Radio Information Engine."""

from __future__ import annotations

from typing import Any

from simple_ros.node import NodeHandle
from simple_ros_engines.mapping_parameter import declare_mapping
from simple_ros_engines.radio.carrier import Carrier, resource_blocks
from simple_ros_engines.radio_information.anomalies import AnomalyKind
from simple_ros_engines.radio_information.core import RadioSettings
from simple_ros_engines.radio_information.sources.base import (
    MetricsSource,
    options_with_defaults,
)

__all__ = ["radio_settings", "source_options"]


async def source_options(node: NodeHandle, name: str) -> dict[str, Any]:
    """What parameters say of a source's options; those that nobody set are left out."""
    group = name.replace("-", "_")
    chosen = {}
    options = options_with_defaults(name)
    for option, default in options.items():
        kind, default = ("int[]", []) if default == () else ("", default)
        value = await node.declare_parameter(
            f"~{group}/{option}", default, type=kind, read_only=True
        )
        if value != default:
            chosen[option] = value
    return chosen | await declare_mapping(node, "~source_options", options)


async def radio_settings(node: NodeHandle, source: MetricsSource) -> RadioSettings:
    """What parameters say of the engine; declares them."""
    get = node.declare_parameter
    window = int(await get("~history_window_size", 50, minimum=10, maximum=10_000, read_only=True))
    fill = int(await get("~interpolate", 0, minimum=0, maximum=1000, read_only=True))
    horizon = float(await get("~prediction_horizon", 1.0, minimum=0.1, maximum=60, read_only=True))
    mhz = int(await get("~bandwidth_mhz", 20, read_only=True))
    scs = int(await get("~scs_khz", 30, choices=(15, 30, 60), read_only=True))
    forget = float(await get("~forget_after", 3600.0, minimum=60, maximum=1e9, read_only=True))
    thresholds = {
        kind: float(await get(f"~{kind.value.lower()}", default, minimum=0, read_only=True))
        for kind, default in (
            (AnomalyKind.SNR_DROP, 5.0),
            (AnomalyKind.BLER_SPIKE, 0.15),
            (AnomalyKind.LATENCY_SPIKE, 30.0),
        )
    }
    return RadioSettings(
        Carrier(scs, resource_blocks(scs, mhz)),
        window=window,
        horizon_s=horizon,
        period_s=source.period_s,
        silent_s=max(2.0, 5 * source.period_s),
        forget_s=forget,
        thresholds=thresholds,
        fill=fill,
        live=source.live,
    )

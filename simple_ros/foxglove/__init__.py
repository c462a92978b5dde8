"""The Foxglove bridge: everything live, in apps that speak the Foxglove WebSocket protocol.

::

    from simple_ros import aio
    from simple_ros.foxglove import Bridge, BridgeOptions

    async with aio.NodeHandle("bridge") as node:
        bridge = Bridge(node, BridgeOptions())
        async with bridge.server.listening(port=8765):
            await bridge.run()

`FoxgloveServer` alone serves channels that are made by hand, `BagPlayback` those of bags. Programs need
neither: ``simple-ros foxglove`` does it all.
"""

from __future__ import annotations

from simple_ros.foxglove.access import Access
from simple_ros.foxglove.assets import AssetRoots
from simple_ros.foxglove.bridge import Bridge, BridgeOptions
from simple_ros.foxglove.playback import BagPlayback, PlaybackOptions
from simple_ros.foxglove.rates import TopicLimits
from simple_ros.foxglove.recording import Recording
from simple_ros.foxglove.server import FoxgloveServer, ServerOptions

__all__ = [
    "Access",
    "AssetRoots",
    "BagPlayback",
    "Bridge",
    "BridgeOptions",
    "FoxgloveServer",
    "PlaybackOptions",
    "Recording",
    "ServerOptions",
    "TopicLimits",
]

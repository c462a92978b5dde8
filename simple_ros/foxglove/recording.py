"""Recording what clients see: every message of every channel that some client is subscribed to."""

from __future__ import annotations

import asyncio
import base64
import logging
from collections.abc import Sequence
from pathlib import Path

from simple_ros.bag.series import BagSeries, RecordedTopic, SeriesOptions
from simple_ros.bag.writing_thread import WritingThread
from simple_ros.foxglove.frames import Channel
from simple_ros.names import canonical

__all__ = ["Recording"]

logger = logging.getLogger(__name__)

_CACHE_BYTES = 100 * 1024 * 1024


class Recording:
    """Writes what a server sends into an MCAP file; give it to `FoxgloveServer.tap`.

    Args:
        path: The file, which must not exist.

    Raises:
        BagExists: There is such a file.
        DiskFull: There is no room for it.
    """

    def __init__(self, path: Path) -> None:
        self._series = BagSeries(SeriesOptions(path, facts={"source": "foxglove"}))
        self._thread = WritingThread(self._series, _CACHE_BYTES, self._failed)
        self._topics: dict[int, RecordedTopic] = {}
        self._loop = asyncio.get_running_loop()

    def saw(
        self, channel: Channel, stamp_ns: int, payloads: Sequence[bytes], *, latched: bool
    ) -> None:
        """Messages of one channel came at one time; a bag player latches what was latched."""
        topic = self._topics.get(channel.id)
        if topic is None:
            kept = channel.recorded_as
            if kept is None:
                kept = channel.schema_name, base64.b64decode(channel.schema)
            metadata = {"latched": "true"} if latched else {}
            topic = RecordedTopic(canonical(channel.topic), *kept, metadata)
            self._topics[channel.id] = topic
        if self._thread.put(topic, stamp_ns, payloads):
            topic.received += len(payloads)
            return
        if not topic.dropped:
            logger.warning(
                "messages of %s are not recorded: the disk does not keep up", topic.topic
            )
        topic.dropped += len(payloads)

    def _failed(self) -> None:
        """Called from the writing thread: nothing more can be written."""
        self._loop.call_soon_threadsafe(
            lambda: logger.error("the recording has ended: %s", self._thread.failure)
        )

    async def finish(self) -> int:
        """Complete the file; gives the number of messages in it.

        Raises:
            DiskFull: There is no room for as much as an empty file.
        """
        return await asyncio.shield(self._loop.run_in_executor(None, self._finish))

    def _finish(self) -> int:
        self._thread.close()
        drops: dict[str, int] = {}
        for topic in self._topics.values():
            drops[topic.topic] = drops.get(topic.topic, 0) + topic.dropped
        self._series.finish(drops)
        return self._series.message_count

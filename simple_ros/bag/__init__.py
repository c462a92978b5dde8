"""Bags: what flows through topics, recorded into MCAP files, and played back.

::

    from simple_ros.bag import Bag

    with Bag("drive.mcap") as bag:
        for message in bag.messages(["odom"]):
            print(message.log_time, message.decoded())

Recording and playing are done by `Recorder` and `Player`, each through an ordinary node, or by
``simple-ros bag``.
"""

from __future__ import annotations

from simple_ros.bag.errors import (
    BagDamaged,
    BagError,
    BagExists,
    BagUnavailable,
    DiskFull,
    NotABag,
    NothingToPlay,
)
from simple_ros.bag.messages import BagMessage, Topic
from simple_ros.bag.plan import SplitRule, TopicSelection
from simple_ros.bag.player import Player, PlayOptions
from simple_ros.bag.reader import Bag
from simple_ros.bag.recorder import Recorder, RecordingSummary
from simple_ros.bag.series import Attached, RecordedTopic, SeriesOptions
from simple_ros.bag.writer import BagWriter

__all__ = [
    "Attached",
    "Bag",
    "BagDamaged",
    "BagError",
    "BagExists",
    "BagMessage",
    "BagUnavailable",
    "BagWriter",
    "DiskFull",
    "NotABag",
    "NothingToPlay",
    "PlayOptions",
    "Player",
    "RecordedTopic",
    "Recorder",
    "RecordingSummary",
    "SeriesOptions",
    "SplitRule",
    "Topic",
    "TopicSelection",
]

"""Diagnostics: every component says how it is, once a second.

::

    updater = await DiagnosticUpdater.create(node, hardware_id="lidar 7")
    rate = FrequencyMonitor(9, 11)
    updater.add("scan rate", rate)
    ...
    rate.tick(updater.now())

`simple_ros.diagnostics.blocking` has the updater for programs without an event loop.
"""

from simple_ros.diagnostics.aggregator import Aggregator
from simple_ros.diagnostics.monitors import DelayMonitor, FrequencyMonitor, Heartbeat
from simple_ros.diagnostics.nodes import DiagnosticAggregator, DiagnosticUpdater, TopicWatch
from simple_ros.diagnostics.status import ERROR, OK, STALE, WARN, Status
from simple_ros.diagnostics.tasks import Tasks
from simple_ros.diagnostics.topic_statistics import TopicFacts, TopicStatistics

__all__ = [
    "ERROR",
    "OK",
    "STALE",
    "WARN",
    "Aggregator",
    "DelayMonitor",
    "DiagnosticAggregator",
    "DiagnosticUpdater",
    "FrequencyMonitor",
    "Heartbeat",
    "Status",
    "Tasks",
    "TopicFacts",
    "TopicStatistics",
    "TopicWatch",
]

"""Events of a board as sentences for its log."""

from __future__ import annotations

import logging

from simple_ros_firmware_bridge.mapping import graph_type
from simple_ros_firmware_bridge.xrce.events import (
    Endpoint,
    EndpointGone,
    EndpointRefused,
    Event,
    ReaderReady,
    ServiceOffered,
    ServiceWanted,
    SessionClosed,
    SessionOpened,
    SessionResumed,
    WriterReady,
)

__all__ = ["words_for"]


def words_for(event: Event) -> tuple[int, str]:
    """Level of `logging` and a sentence."""
    match event:
        case SessionOpened(key, is_same):
            again = " again" if is_same else ""
            return logging.INFO, f"connected{again} (client key {key})"
        case SessionResumed(key):
            return logging.INFO, f"goes on as if nothing had happened (client key {key})"
        case SessionClosed(reason):
            return logging.WARNING, f"session over: {reason}"
        case WriterReady(endpoint):
            return logging.INFO, f"publishes {endpoint.topic} ({_type(endpoint)})"
        case ReaderReady(endpoint):
            return logging.INFO, f"subscribes {endpoint.topic} ({_type(endpoint)})"
        case ServiceOffered(endpoint):
            return logging.INFO, f"provides service {endpoint.topic}"
        case ServiceWanted(endpoint):
            return logging.INFO, f"calls service {endpoint.topic}"
        case EndpointRefused(reason):
            return logging.ERROR, f"refused: {reason}"
        case EndpointGone(object_id):
            return logging.INFO, f"deleted its object {object_id!r}"
        case _:
            return logging.DEBUG, repr(event)


def _type(endpoint: Endpoint) -> str:
    return graph_type(endpoint.type_name) or endpoint.type_name

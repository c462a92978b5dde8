"""One client's conversation. Pure: frames in, events and frames out.

Whatever a client sends, nothing raises: what makes no sense is answered with a status of level 2, and
the conversation goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

from simple_ros.foxglove import frames, requests
from simple_ros.foxglove.catalog import Catalog
from simple_ros.foxglove.errors import InvalidRequest, shortened
from simple_ros.foxglove.events import (
    AssetWanted,
    Called,
    ChannelClosed,
    ChannelOpened,
    ChannelUnwanted,
    ChannelWanted,
    Event,
    GraphWanted,
    ParametersSet,
    ParametersWanted,
    PlaybackWanted,
    Published,
)
from simple_ros.foxglove.frames import Channel, Level, Service
from simple_ros.foxglove.requests import ClientChannel, FetchAsset, GetParameters, PlaybackControl

__all__ = ["MAX_IN_FLIGHT", "Frame", "Session"]

MAX_IN_FLIGHT = 32
"""Calls of services, and of assets, that one client may have under way."""

Frame: TypeAlias = str | bytes


_NEEDS: dict[type, str] = {
    requests.AdvertiseChannels: "clientPublish",
    requests.UnadvertiseChannels: "clientPublish",
    requests.ClientMessage: "clientPublish",
    GetParameters: "parameters",
    requests.SetParameters: "parameters",
    requests.SubscribeParameters: "parametersSubscribe",
    requests.UnsubscribeParameters: "parametersSubscribe",
    requests.SubscribeGraph: "connectionGraph",
    requests.UnsubscribeGraph: "connectionGraph",
    PlaybackControl: "playbackControl",
}


class Session:
    """What one client has asked for, and what it is to be told.

    Args:
        catalog: What the server offers, as it changes.
        capabilities: What the client may ask for.
        with_metadata: Whether its subprotocol knows metadata of channels.

    Attributes:
        subscriptions: Subscription ids by channel id.
        wants_graph: Whether it is told changes of the graph.
        controls_playback: Whether it knows the frames about playback.
        refused: How many of its requests made no sense or could not be granted.
    """

    def __init__(
        self, catalog: Catalog, capabilities: Iterable[str], *, with_metadata: bool = True
    ) -> None:
        self.subscriptions: dict[int, int] = {}
        self.wants_graph = False
        self.controls_playback = False
        self.refused = 0
        self._catalog = catalog
        self._capabilities = frozenset(capabilities)
        self._with_metadata = with_metadata
        self._channels_by_subscription: dict[int, int] = {}
        self._client_channels: dict[int, ClientChannel] = {}
        self._parameters: set[str] = set()
        self._all_parameters = False
        self._calls: set[tuple[int, int]] = set()
        self._assets: set[int] = set()
        self._events: list[Event] = []
        self._frames: list[Frame] = []
        self._handlers: dict[type, Callable[[Any], None]] = {
            requests.Subscribe: self._subscribe,
            requests.Unsubscribe: self._unsubscribe,
            requests.AdvertiseChannels: self._open_channels,
            requests.UnadvertiseChannels: self._close_channels,
            requests.ClientMessage: self._message,
            requests.CallService: self._call,
            requests.GetParameters: self._get_parameters,
            requests.SetParameters: self._set_parameters,
            requests.SubscribeParameters: self._subscribe_parameters,
            requests.UnsubscribeParameters: self._unsubscribe_parameters,
            requests.SubscribeGraph: self._subscribe_graph,
            requests.UnsubscribeGraph: self._unsubscribe_graph,
            requests.FetchAsset: self._fetch_asset,
            requests.PlaybackControl: self._playback,
        }

    # -- in and out ----------------------------------------------------------------------------

    def receive(self, frame: Frame) -> None:
        """Take a frame of the client."""
        try:
            request = requests.parsed(frame)
        except InvalidRequest as error:
            self.complain(f"Invalid message: {error}")
            return
        if request is None:
            return
        needed = _NEEDS.get(type(request))
        if needed is not None and needed not in self._capabilities:
            self.complain(f"This server does not offer {needed}")
            return
        self._handlers[type(request)](request)

    def events(self) -> list[Event]:
        """What happened since the last call."""
        events, self._events = self._events, []
        return events

    def frames(self) -> list[Frame]:
        """What is to be sent since the last call."""
        frames, self._frames = self._frames, []
        return frames

    def begin(self, server_info: str) -> None:
        """The connection stands: introduce the server and all it offers."""
        self._frames.append(server_info)
        self.offer_channels(list(self._catalog.channels.values()))
        self.offer_services(list(self._catalog.services.values()))

    def begin_again(self, server_info: str) -> None:
        """Let the client forget what it showed; what it is subscribed to stays.

        Apps forget the types of channels, too, so these are offered once more, just as they were.
        """
        self._frames.append(server_info)
        self.offer_channels(list(self._catalog.channels.values()))

    def complain(self, message: str, level: Level = Level.ERROR) -> None:
        """Tell the client that something is wrong."""
        self.refused += 1
        self._frames.append(frames.status(level, shortened(message)))

    def say(self, frame: Frame) -> None:
        """Send a frame that was made elsewhere."""
        self._frames.append(frame)

    # -- what is offered -----------------------------------------------------------------------

    def offer_channels(self, channels: list[Channel]) -> None:
        """There are new channels."""
        self._frames += frames.advertise(channels, with_metadata=self._with_metadata)

    def withdraw_channels(self, ids: Iterable[int]) -> None:
        """Channels have gone, and subscriptions with them."""
        gone = list(ids)
        for channel in gone:
            self._end_subscription(self.subscriptions.get(channel, -1))
        if gone:
            self._frames.append(frames.unadvertise(gone))

    def offer_services(self, services: list[Service]) -> None:
        """There are new services."""
        if services and "services" in self._capabilities:
            self._frames.append(frames.advertise_services(services))

    def withdraw_services(self, ids: Iterable[int]) -> None:
        """Services have gone."""
        gone = list(ids)
        if gone and "services" in self._capabilities:
            self._frames.append(frames.unadvertise_services(gone))

    # -- subscriptions -------------------------------------------------------------------------

    def _subscribe(self, request: requests.Subscribe) -> None:
        for subscription, channel in request.subscriptions:
            if subscription in self._channels_by_subscription:
                self.complain(f"Subscription {subscription} exists already; its id is not reused")
            elif channel not in self._catalog.channels:
                self.complain(f"There is no channel {channel}")
            elif channel in self.subscriptions:
                self.complain(f"Channel {channel} is subscribed already", Level.WARNING)
            else:
                self.subscriptions[channel] = subscription
                self._channels_by_subscription[subscription] = channel
                self._events.append(ChannelWanted(channel, subscription))

    def _unsubscribe(self, request: requests.Unsubscribe) -> None:
        # Apps end subscriptions of channels that have gone already, so unknown ids are no error.
        for subscription in request.subscription_ids:
            self._end_subscription(subscription)

    def _end_subscription(self, subscription: int) -> None:
        channel = self._channels_by_subscription.pop(subscription, None)
        if channel is not None:
            del self.subscriptions[channel]
            self._events.append(ChannelUnwanted(channel))

    # -- what the client publishes -------------------------------------------------------------

    def _open_channels(self, request: requests.AdvertiseChannels) -> None:
        for channel in request.channels:
            if channel.id in self._client_channels:
                self.complain(f"Client channel {channel.id} exists already", Level.WARNING)
            elif channel.encoding not in ("json", "protobuf"):
                self.complain(
                    f"Client channel {channel.topic}: encoding {channel.encoding!r} is not "
                    "understood; use json or protobuf"
                )
            else:
                self._client_channels[channel.id] = channel
                self._events.append(ChannelOpened(channel))

    def _close_channels(self, request: requests.UnadvertiseChannels) -> None:
        for channel_id in request.channel_ids:
            channel = self._client_channels.pop(channel_id, None)
            if channel is None:
                self.complain(f"There is no client channel {channel_id}", Level.WARNING)
            else:
                self._events.append(ChannelClosed(channel))

    def _message(self, message: requests.ClientMessage) -> None:
        channel = self._client_channels.get(message.channel_id)
        if channel is None:
            self.complain(f"There is no client channel {message.channel_id}")
        else:
            self._events.append(Published(channel, message.payload))

    # -- services ------------------------------------------------------------------------------

    def _call(self, call: requests.CallService) -> None:
        key = call.service_id, call.call_id
        service = self._catalog.services.get(call.service_id)
        if service is None or "services" not in self._capabilities:
            self._refuse(key, f"service {call.service_id}", "there is no such service")
        elif key in self._calls:
            self._refuse(key, service.name, f"call {call.call_id} is under way already")
        elif len(self._calls) >= MAX_IN_FLIGHT:
            self._refuse(key, service.name, f"more than {MAX_IN_FLIGHT} calls are under way")
        elif call.encoding != "json":
            self._refuse(
                key, service.name, f"encoding {call.encoding!r} is not understood; use json"
            )
        else:
            self._calls.add(key)
            self._events.append(Called(service, call.call_id, call.payload))

    def answer(self, call: Called, payload: bytes) -> None:
        """Answer a call in JSON."""
        key = call.service.id, call.call_id
        if key in self._calls:
            self._calls.discard(key)
            self._frames.append(frames.service_response(*key, "json", payload))

    def fail(self, call: Called, reason: str) -> None:
        """Say why a call is not answered."""
        key = call.service.id, call.call_id
        if key in self._calls:
            self._calls.discard(key)
            self._refuse(key, call.service.name, reason)

    def _refuse(self, key: tuple[int, int], name: str, reason: str) -> None:
        self._frames.append(frames.service_failure(*key, shortened(reason)))
        # Apps show nothing for the failure itself.
        self.complain(f"Service {name}: {reason}")

    # -- parameters ----------------------------------------------------------------------------

    def _get_parameters(self, request: GetParameters) -> None:
        self._events.append(ParametersWanted(request.names, request.id))

    def _set_parameters(self, request: requests.SetParameters) -> None:
        self._events.append(ParametersSet(request.parameters, request.id))

    def _subscribe_parameters(self, request: requests.SubscribeParameters) -> None:
        self._all_parameters = self._all_parameters or not request.names
        self._parameters.update(name.lstrip("/") for name in request.names)

    def _unsubscribe_parameters(self, request: requests.UnsubscribeParameters) -> None:
        if not request.names:
            self._all_parameters = False
            self._parameters.clear()
        self._parameters.difference_update(name.lstrip("/") for name in request.names)

    def wants_parameter(self, name: str) -> bool:
        """Whether changes of a parameter are told; ``name`` without leading slash."""
        return self._all_parameters or name in self._parameters

    # -- the rest ------------------------------------------------------------------------------

    def _subscribe_graph(self, request: requests.SubscribeGraph) -> None:  # noqa: ARG002
        self.wants_graph = True
        self._events.append(GraphWanted())

    def _unsubscribe_graph(self, request: requests.UnsubscribeGraph) -> None:  # noqa: ARG002
        self.wants_graph = False

    def _fetch_asset(self, request: FetchAsset) -> None:
        reason = ""
        if "assets" not in self._capabilities:
            reason = "this server has no assets"
        elif request.request_id in self._assets:
            reason = f"request {request.request_id} is under way already"
        elif len(self._assets) >= MAX_IN_FLIGHT:
            reason = f"more than {MAX_IN_FLIGHT} assets are under way"
        if reason:
            self._frames.append(frames.asset_error(request.request_id, reason))
        else:
            self._assets.add(request.request_id)
            self._events.append(AssetWanted(request.uri, request.request_id))

    def send_asset(self, request_id: int, data: bytes) -> None:
        """Send a file that was asked for."""
        self._assets.discard(request_id)
        self._frames.append(frames.asset(request_id, data))

    def refuse_asset(self, request_id: int, reason: str) -> None:
        """Say why a file is not sent."""
        self._assets.discard(request_id)
        self._frames.append(frames.asset_error(request_id, shortened(reason)))

    def _playback(self, control: PlaybackControl) -> None:
        self.controls_playback = True
        self._events.append(PlaybackWanted(control))

    def end(self) -> None:
        """The client has gone: all it published and was subscribed to ends."""
        self._events += [ChannelUnwanted(channel) for channel in self.subscriptions]
        self._events += [ChannelClosed(channel) for channel in self._client_channels.values()]
        self.subscriptions.clear()
        self._channels_by_subscription.clear()
        self._client_channels.clear()

"""One WebSocket connection: bytes of a socket in, messages out, and the reverse.

The protocol is that of the library ``websockets`` without its input and output, so that what waits to be
sent waits where it is counted (see `queue`), and not in buffers of a library.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable, Iterable
from typing import Protocol

from websockets.exceptions import InvalidState
from websockets.extensions.permessage_deflate import ServerPerMessageDeflateFactory
from websockets.frames import Frame, Opcode
from websockets.http11 import Request
from websockets.protocol import OPEN
from websockets.server import ServerProtocol
from websockets.typing import Subprotocol

from simple_ros.foxglove.access import Refusal
from simple_ros.foxglove.frames import SUBPROTOCOLS

__all__ = ["MAX_MESSAGE_BYTES", "Connection", "Receiver"]

logger = logging.getLogger(__name__)

MAX_MESSAGE_BYTES = 128 * 1024 * 1024
"""Largest message a client may send; the connection of one that sends more is closed."""

_HANDSHAKE_S = 10.0
_PING_S = 20.0
_CLOSE_S = 3.0
_WRITE_BUFFER_BYTES = 64 * 1024
_KERNEL_BUFFER_BYTES = 256 * 1024


class Receiver(Protocol):
    """What a connection brings its messages to."""

    def received(self, message: str | bytes) -> None:
        """A whole message came."""

    def writable(self) -> None:
        """More can be sent again."""

    def lost(self) -> None:
        """The connection has ended."""


class Connection(asyncio.Protocol):
    """One client's socket.

    Args:
        refusal: Tells why a request to connect is refused, or None.
        accepted: Called when the connection stands; gives what its messages are brought to.
        loop: The event loop.
        compress: Whether to compress for clients that can bear it.

    Attributes:
        peer: Address of the client, for people.
        subprotocol: Which was agreed on.
        compresses: Whether compression was agreed on, too.
    """

    def __init__(
        self,
        refusal: Callable[[Request], Refusal | None],
        accepted: Callable[[Connection], Receiver],
        loop: asyncio.AbstractEventLoop,
        *,
        compress: bool = False,
    ) -> None:
        self.peer = ""
        self._takes_more = False
        self.subprotocol = ""
        self.compresses = False
        self._refusal = refusal
        self._accepted = accepted
        self._loop = loop
        self._protocol = ServerProtocol(
            subprotocols=[Subprotocol(name) for name in SUBPROTOCOLS],
            max_size=MAX_MESSAGE_BYTES,
            extensions=[ServerPerMessageDeflateFactory()] if compress else None,
        )
        self._transport: asyncio.Transport | None = None
        self._receiver: Receiver | None = None
        self._parts: list[bytes] = []
        self._opcode = Opcode.BINARY
        self._timer: asyncio.TimerHandle | None = None
        self._pinged = False

    # -- asyncio's calls -----------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The socket is there."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        transport.set_write_buffer_limits(high=_WRITE_BUFFER_BYTES)
        found = transport.get_extra_info("socket")
        if found is not None:
            # More would hide in the kernel, where no fairness reaches it.
            found.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KERNEL_BUFFER_BYTES)
            found.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        address = transport.get_extra_info("peername") or ("?", 0)
        self.peer = f"{address[0]}:{address[1]}"
        self._set_timer(_HANDSHAKE_S, self.abort)

    def data_received(self, data: bytes) -> None:
        """Bytes came."""
        # A long message on a slow link may keep the answer to a ping waiting.
        self._pinged = False
        self._protocol.receive_data(data)
        self._after_input()

    def eof_received(self) -> None:
        """The client sends no more."""
        self._protocol.receive_eof()
        self._after_input()

    def pause_writing(self) -> None:
        """The socket takes no more for now."""
        self._takes_more = False

    def resume_writing(self) -> None:
        """The socket takes bytes again."""
        self._takes_more = True
        if self._receiver is not None:
            self._receiver.writable()

    def connection_lost(self, error: Exception | None) -> None:
        """The socket is gone."""
        self._cancel_timer()
        self._takes_more = False
        self._transport = None
        receiver, self._receiver = self._receiver, None
        if receiver is not None:
            logger.debug("client %s has gone: %s", self.peer, error or "closed")
            receiver.lost()

    # -- what comes ----------------------------------------------------------------------------

    def _after_input(self) -> None:
        for event in self._protocol.events_received():
            if isinstance(event, Request):
                self._shake_hands(event)
            elif isinstance(event, Frame):
                self._frame_came(event)
        self._flush()
        if self._protocol.close_expected():
            self._set_timer(_CLOSE_S, self.abort)

    def _shake_hands(self, request: Request) -> None:
        refusal = self._refusal(request)
        is_plain = "websocket" not in request.headers.get("Upgrade", "").lower()
        if refusal is None or is_plain:
            response = self._protocol.accept(request)
        else:
            response = self._protocol.reject(refusal.status, f"{refusal.reason}\n")
        self._protocol.send_response(response)
        self._flush()
        if self._protocol.state is OPEN:
            self.subprotocol = str(self._protocol.subprotocol)
            self.compresses = bool(self._protocol.extensions)
            self._takes_more = True
            self._set_timer(_PING_S, self._ping)
            self._receiver = self._accepted(self)

    def _frame_came(self, frame: Frame) -> None:
        if frame.opcode in (Opcode.TEXT, Opcode.BINARY):
            self._opcode = frame.opcode
            self._parts = [bytes(frame.data)]
        elif frame.opcode is Opcode.CONT:
            self._parts.append(bytes(frame.data))
        else:
            return
        if frame.fin:
            self._message_came(b"".join(self._parts))
            self._parts = []

    def _message_came(self, data: bytes) -> None:
        if self._receiver is None:
            return
        if self._opcode is Opcode.BINARY:
            self._receiver.received(data)
            return
        try:
            text = data.decode()
        except UnicodeDecodeError:
            self.close(1007, "a text that is no UTF-8")
            return
        self._receiver.received(text)

    # -- what goes -----------------------------------------------------------------------------

    @property
    def is_writable(self) -> bool:
        """Whether what is sent now leaves at once or nearly."""
        # A transport that is closing breaks when it is written to.
        transport = self._transport
        return self._takes_more and transport is not None and not transport.is_closing()

    def send(self, message: str | bytes) -> None:
        """Send a message, after all that was sent before."""
        if self._protocol.state is not OPEN:
            return
        if isinstance(message, str):
            self._protocol.send_text(message.encode())
        else:
            self._protocol.send_binary(message)
        self._flush()

    def send_raw(self, parts: Iterable[bytes]) -> None:
        """Send whole WebSocket frames that were made elsewhere, given in parts."""
        transport = self._transport
        if self._protocol.state is OPEN and transport is not None and not transport.is_closing():
            transport.writelines(parts)

    def close(self, code: int = 1000, reason: str = "") -> None:
        """Say goodbye; a client that does not answer is cut off after 3 s."""
        if self._protocol.state is OPEN:
            try:
                self._protocol.send_close(code, reason)
            except InvalidState:
                return
            self._flush()
            self._set_timer(_CLOSE_S, self.abort)
        elif self._receiver is None:
            self.abort()

    def _flush(self) -> None:
        for data in self._protocol.data_to_send():
            if self._transport is None or self._transport.is_closing():
                return
            if data:
                self._transport.write(data)
            else:
                # The library's sign for the end of what is sent.
                self._transport.close()

    # -- time ----------------------------------------------------------------------------------

    def _ping(self) -> None:
        if self._pinged:
            self._protocol.fail(1011, "no answer to a ping")
            self._flush()
            self._set_timer(_CLOSE_S, self.abort)
            return
        if self._protocol.state is OPEN:
            self._pinged = True
            self._protocol.send_ping(b"")
            self._flush()
            self._set_timer(_PING_S, self._ping)

    def _set_timer(self, delay_s: float, action: Callable[[], None]) -> None:
        self._cancel_timer()
        self._timer = self._loop.call_later(delay_s, action)

    def _cancel_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def abort(self) -> None:
        """End the connection at once."""
        self._cancel_timer()
        if self._transport is not None:
            self._transport.abort()

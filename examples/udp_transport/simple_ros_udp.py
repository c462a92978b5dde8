"""A transport of another package: messages as UDP datagrams.

On a radio link that loses packets, TCP holds back everything behind a lost one until it has been sent
again. For topics where only the newest message counts (a video, a pose), a datagram is better lost.

    pip install ./examples/udp_transport
    SIMPLE_ROS_TRANSPORTS=local,udp,tcp python my_node.py

It carries topics published best effort; reliable ones go on over TCP. Each datagram begins with a random
number of its sender, so that one socket tells its senders apart; an empty one says hello, and is repeated
every second as a sign of life; one with a mark says goodbye.
"""

import asyncio
import secrets

from simple_ros.net.transport import Acceptor, Listener, Place, Transport, feed

HELLO = b"H"
DATA = b"D"
BYE = b"B"
ID_BYTES = 8
MAX_DATAGRAM = 65_000
SIGN_OF_LIFE_S = 1.0
SILENCE_S = 3.5


class UdpTransport(Transport):
    """Sends each write as one datagram."""

    scheme = "udp"
    is_reliable = False
    max_write_bytes = MAX_DATAGRAM - ID_BYTES - 1

    async def listen(self, accept: Acceptor, place: Place) -> Listener:
        loop = asyncio.get_running_loop()
        host = place.ip if place.is_local else "0.0.0.0"
        listener = UdpListener(accept)
        transport, _ = await loop.create_datagram_endpoint(lambda: listener, local_addr=(host, 0))
        listener.address = f"udp://{place.ip}:{transport.get_extra_info('sockname')[1]}"
        return listener

    async def dial(self, address: str, protocol: asyncio.Protocol) -> None:
        host, _, port = address.removeprefix("udp://").rpartition(":")
        loop = asyncio.get_running_loop()
        link = UdpLink(protocol, address)
        await loop.create_datagram_endpoint(lambda: link, remote_addr=(host, int(port)))
        try:
            await link.answered.wait()
        except asyncio.CancelledError:
            link.close()
            raise
        if link.is_closing():
            raise ConnectionRefusedError(f"nobody listens at {address}")
        protocol.connection_made(link)


class UdpLink(asyncio.DatagramProtocol, asyncio.Transport):
    """The sending end: a transport for its protocol, itself on a datagram socket."""

    def __init__(self, protocol: asyncio.Protocol, address: str):
        asyncio.Transport.__init__(self, {"peername": address})
        self.answered = asyncio.Event()
        self.id = secrets.token_bytes(ID_BYTES)
        self.protocol = protocol
        self.closing = False
        self.loop = asyncio.get_running_loop()
        self.heard = self.loop.time()

    def connection_made(self, transport):
        self.datagrams = transport
        self.say_hello()

    def say_hello(self):
        self.datagrams.sendto(HELLO + self.id)
        self.timer = self.loop.call_later(SIGN_OF_LIFE_S, self.say_hello)
        if self.answered.is_set() and self.loop.time() - self.heard > SILENCE_S:
            self.abort()

    def datagram_received(self, data, addr):
        """The listener answers each hello; nothing else comes back."""
        self.heard = self.loop.time()
        if data == BYE + self.id:
            self.abort()
        self.answered.set()

    def error_received(self, error):
        """The host says that nobody listens."""
        self.abort()
        self.answered.set()

    def write(self, data):
        if not self.closing:
            self.datagrams.sendto(DATA + self.id + data)

    def set_write_buffer_limits(self, high=None, low=None):
        """A datagram that does not fit the socket is lost; nothing waits."""

    def is_closing(self):
        return self.closing

    def close(self):
        if not self.closing:
            self.datagrams.sendto(BYE + self.id)
            self.abort()

    def abort(self):
        if not self.closing:
            self.closing = True
            self.timer.cancel()
            self.datagrams.close()
            if self.answered.is_set():
                self.loop.call_soon(self.protocol.connection_lost, None)


class UdpListener(asyncio.DatagramProtocol, Listener):
    """The receiving end of a node: one socket, a protocol for each sender."""

    def __init__(self, accept: Acceptor):
        self.address = ""
        self.accept = accept
        self.senders: dict[bytes, UdpSender] = {}
        self.loop = asyncio.get_running_loop()

    @property
    def addresses(self):
        return (self.address,)

    def connection_made(self, transport):
        self.datagrams = transport
        self.watch()

    def datagram_received(self, data, addr):
        kind, sender_id, payload = data[:1], data[1 : 1 + ID_BYTES], data[1 + ID_BYTES :]
        if len(sender_id) < ID_BYTES:
            return
        sender = self.senders.get(sender_id)
        if kind == BYE:
            if sender is not None:
                sender.lost()
            return
        if sender is None:
            if kind != HELLO:
                return
            sender = self.senders[sender_id] = UdpSender(self, sender_id, addr)
            sender.protocol.connection_made(sender)
        sender.heard = self.loop.time()
        if kind == HELLO:
            self.datagrams.sendto(HELLO + sender_id, addr)
        elif kind == DATA and sender.reading:
            feed(sender.protocol, payload)

    def watch(self):
        """Let go of senders that went without a goodbye."""
        now = self.loop.time()
        for sender in list(self.senders.values()):
            if now - sender.heard > SILENCE_S:
                sender.lost()
        self.timer = self.loop.call_later(SIGN_OF_LIFE_S, self.watch)

    async def close(self):
        self.timer.cancel()
        for sender in list(self.senders.values()):
            sender.close()
        self.datagrams.close()


class UdpSender(asyncio.Transport):
    """One sender, as its protocol sees it."""

    def __init__(self, listener: UdpListener, sender_id: bytes, addr):
        super().__init__({"peername": addr})
        self.listener = listener
        self.id = sender_id
        self.addr = addr
        self.reading = True
        self.heard = 0.0
        self.protocol = listener.accept()

    def pause_reading(self):
        """What comes meanwhile is lost: nobody can be held back."""
        self.reading = False

    def resume_reading(self):
        self.reading = True

    def is_closing(self):
        return self.id not in self.listener.senders

    def close(self):
        if not self.is_closing():
            self.listener.datagrams.sendto(BYE + self.id, self.addr)
            self.lost()

    abort = close

    def lost(self):
        del self.listener.senders[self.id]
        self.listener.loop.call_soon(self.protocol.connection_lost, None)

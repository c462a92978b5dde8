"""An XRCE client: finds the agent, makes its topics there, publishes, listens, and stays connected.

No hardware, no waiting: bytes and time come in as arguments, messages go out through ``send``. When the agent
goes away the session is kept; when it comes back and still knows the board, everything goes on as if nothing
had happened, else the session is begun anew. Times are milliseconds.
"""

from struct import pack, pack_into, unpack_from

import creation
from streams import MESSAGE_BYTES, SLOTS, ReliableInput, ReliableOutput

import micropython

LOOKING, CONNECTING, CREATING, RUNNING = 0, 1, 2, 3

_SESSION = 0x81
_BEST_EFFORT, _RELIABLE = 0x01, 0x80
_RETRY_MS = 1000
_LOOK_MS = 250
_ASK_AFTER_MS = 500
_AWAY_AFTER_MS = 1500
_TIME_EVERY_MS = 30000
_LATE_REPLY_MS = 20
_PIECE = MESSAGE_BYTES - 8
BEST_EFFORT_BYTES = MESSAGE_BYTES - 12
RELIABLE_BYTES = SLOTS * _PIECE - 8
_LARGEST_SAMPLE = 2000


class Client:
    """One board.

    Args:
        key: Four bytes that are this board's own.
        name: What it is called at the agent.
        topics: `creation.Topic` objects.
        clock: A `clock.Clock`, which is set by the agent.
        send: Called with a buffer and a size: a message for the line.
        say: Called with text for a person.

    Attributes:
        stage: `LOOKING`, `CONNECTING`, `CREATING` or `RUNNING`.
        is_away: Whether the agent has been silent for so long that publishing makes no sense.
        sessions: How often a session was begun.
    """

    def __init__(self, key, name, topics, clock, send, say):
        self.stage = LOOKING
        self.is_away = False
        self.sessions = 0
        self._key = key
        self._name = name
        self._topics = topics
        self._clock = clock
        self._send = send
        self._say = say
        self.output = ReliableOutput(send, _SESSION, _RELIABLE)
        self._input = ReliableInput()
        self._scratch = bytearray(MESSAGE_BYTES)
        self._reply = bytearray(13)
        self._question = bytearray(b"\x80\0\0\0\x02\x01\x08\0\0\x0a\xff\xfd\x02\0\0\0")
        self._whole = bytearray(_LARGEST_SAMPLE)
        self._whole_size = 0
        self._number = 0
        self._request = 0
        self._to_create = []
        self._awaited = 0
        self._act_at = 0
        self._tries = 0
        self._heard_at = 0
        self._time_at = 0
        self._asked = None

    # -- the program's side --------------------------------------------------------------------

    @property
    def is_connected(self):
        """Whether there is somebody to publish to."""
        return self.stage == RUNNING and not self.is_away

    @micropython.native
    def can_publish(self, topic, size):
        """Whether a sample of that many bytes can be sent now."""
        if not self.is_connected:
            return False
        return not topic.is_reliable or self.output.free > (size + 7) // _PIECE

    @micropython.native
    def publish(self, topic, sample, now):
        """Send a sample, plain CDR.

        It must not be larger than `BEST_EFFORT_BYTES` or `RELIABLE_BYTES`. Ask `can_publish` before.
        """
        size = len(sample)
        self._request = self._request + 1 & 0x7FFF
        if not topic.is_reliable:
            buffer = self._scratch
            pack_into("<BBH", buffer, 0, _SESSION, _BEST_EFFORT, self._number)
            self._number = self._number + 1 & 0xFFFF
            self._put_head(buffer, 4, topic, size)
            buffer[12 : 12 + size] = sample
            self._send(buffer, 12 + size)
        elif size + 12 <= MESSAGE_BYTES:
            buffer = self.output.slot()
            self._put_head(buffer, 4, topic, size)
            buffer[12 : 12 + size] = sample
            self.output.commit(12 + size, now)
        else:
            self._publish_in_pieces(topic, sample, size, now)

    @micropython.native
    def _put_head(self, buffer, at, topic, size):
        pack_into("<BBH", buffer, at, 7, 1, size + 4)
        pack_into(">H", buffer, at + 4, self._request)
        buffer[at + 6 : at + 8] = topic.endpoint

    def _publish_in_pieces(self, topic, sample, size, now):
        sample = memoryview(sample)
        at = 0
        while at < size:
            buffer = self.output.slot()
            begin = 8
            if at == 0:
                self._put_head(buffer, 8, topic, size)
                begin = 16
            count = min(size - at, MESSAGE_BYTES - begin)
            buffer[begin : begin + count] = sample[at : at + count]
            at += count
            flags = 3 if at == size else 1
            pack_into("<BBH", buffer, 4, 13, flags, begin - 8 + count)
            self.output.commit(begin + count, now)

    # -- the line's side -----------------------------------------------------------------------

    @micropython.native
    def receive(self, message, size, now):
        """A message of the agent: the first ``size`` bytes of a buffer."""
        if size < 4:
            return
        session, stream, number = unpack_from("<BBH", message)
        if session == _SESSION and self.stage >= CREATING:
            self._heard(now)
        elif session not in (_SESSION, 0x80) or stream:
            return
        if stream < _RELIABLE:
            self._handle(message, 4, size, now)
        elif stream == _RELIABLE:
            self._receive_reliable(number, message, size, now)

    def _heard(self, now):
        self._heard_at = now
        if self.is_away:
            self.is_away = False
            self._say("the bridge is back")

    @micropython.native
    def _receive_reliable(self, number, message, size, now):
        source = self._input
        if source.is_next(number):
            self._handle(message, 4, size, now)
            size = source.early()
            while size:
                self._handle(source.early_message(), 4, size, now)
                size = source.early()
        else:
            source.keep(number, message, size)
        self._acknowledge(source.highest())

    @micropython.native
    def _acknowledge(self, last):
        source = self._input
        pack_into("<BBHBBHH", self._reply, 0, _SESSION, 0, 0, 10, 1, 5, source.next)
        pack_into(">HB", self._reply, 10, source.missing(last), _RELIABLE)
        self._send(self._reply, 13)

    @micropython.native
    def _handle(self, data, at, end, now):
        """The submessages of a message, each at a multiple of four bytes."""
        while at + 4 <= end:
            kind, flags, size = unpack_from("<BBH", data, at)
            at += 4
            if at + size > end or not flags & 1:
                return
            if kind == 9:
                self._data(data, at, size)
            elif kind == 13:
                self._fragment(data, at, size, flags & 2, now)
            elif size >= 5:
                self._handle_answer(kind, data, at, size, now)
            at += size + 3 & ~3

    @micropython.native
    def _handle_answer(self, kind, data, at, size, now):
        if kind == 10:
            first = data[at] | data[at + 1] << 8
            missing = data[at + 2] << 8 | data[at + 3]
            if data[at + 4] == _RELIABLE and self.stage >= CREATING:
                self.output.acknowledged(first, missing, now)
        elif kind == 11:
            if data[at + 4] == _RELIABLE and self.stage >= CREATING:
                self._acknowledge(data[at + 2] | data[at + 3] << 8)
        elif kind == 5:
            self._status(data[at] << 8 | data[at + 1], data[at + 4], now)
        elif kind == 4:
            self._welcome(data[at], now)
        elif kind == 6 and size >= 6:
            self._info(data[at + 5], now)
        elif kind == 15 and size >= 24:
            self._time(data, at, now)

    @micropython.native
    def _data(self, data, at, size):
        if size < 4:
            return
        for topic in self._topics:
            endpoint = topic.endpoint
            if endpoint[0] == data[at + 2] and endpoint[1] == data[at + 3] and topic.handler:
                topic.handler(data, at + 4, size - 4)

    def _fragment(self, data, at, size, is_last, now):
        begin = self._whole_size
        if begin + size > _LARGEST_SAMPLE:
            # Too large for this board; the rest is counted until its end, and thrown away.
            self._whole_size = _LARGEST_SAMPLE
        else:
            self._whole[begin : begin + size] = data[at : at + size]
            self._whole_size += size
        if is_last:
            size, self._whole_size = self._whole_size, 0
            if size < _LARGEST_SAMPLE:
                self._handle(self._whole, 0, size, now)

    # -- from looking to running ---------------------------------------------------------------

    def _info(self, knows_us, now):
        if self.stage == LOOKING:
            self._connect(now)
        elif self.stage == RUNNING and not knows_us:
            self._say("the bridge does not know this board any more: beginning anew")
            self._connect(now)

    def _connect(self, now):
        self.stage = CONNECTING
        self._tries = 0
        self._act_at = now

    def _hello(self, now):
        self._tries += 1
        if self._tries > 5:
            self._look(now)
            return
        self._act_at = now + _RETRY_MS
        hello = b"XRCE\x01\0\x01\x0f" + self._key + pack("<BBH", _SESSION, 0, MESSAGE_BYTES)
        message = b"\x80\0\0\0\0\x01" + pack("<H", len(hello)) + hello
        self._send(message, len(message))

    def _welcome(self, status, now):
        if self.stage != CONNECTING:
            return
        if status:
            self._say(f"the bridge refuses this board (status {status:#x})")
            return
        self.stage = CREATING
        self.is_away = False
        self.sessions += 1
        self.output.reset()
        self._input.reset()
        self._number = self._whole_size = 0
        self._heard_at = now
        self._ask_time(now)
        self._to_create = [(None, 1)]
        for topic in self._topics:
            self._to_create += [(topic, kind) for kind in creation.steps(topic)]
        self._create_next(now)

    def _create_next(self, now):
        self._request += 1
        self._awaited = self._request & 0x7FFF
        topic, kind = self._to_create[0]
        if topic is None:
            body = creation.participant(self._awaited, self._name)
        else:
            body = creation.one_step(self._awaited, topic, kind)
        self._send_reliably(body, now)
        self._act_at = now + 2 * _RETRY_MS

    def _send_reliably(self, body, now):
        buffer = self.output.slot()
        buffer[4 : 4 + len(body)] = body
        self.output.commit(4 + len(body), now)

    def _status(self, request, status, now):
        if self.stage != CREATING or request != self._awaited:
            return
        topic, kind = self._to_create.pop(0)
        if status > 1:
            what = "this board" if topic is None else f"{topic.name} ({topic.type_name})"
            self._say(f"the bridge refuses {what}, status {status:#x}")
        elif topic is not None and topic.endpoint[1] & 15 == kind and topic.handler:
            self._request += 1
            self._send_reliably(creation.read_request(self._request & 0x7FFF, topic), now)
        if self._to_create:
            self._create_next(now)
        else:
            self.stage = RUNNING
            self._say("connected to the bridge")

    def _look(self, now):
        self.stage = LOOKING
        self.is_away = False
        self._act_at = now

    # -- time ----------------------------------------------------------------------------------

    @micropython.native
    def run(self, now):
        """Do what is due; call it every few milliseconds."""
        if self.stage >= CREATING and not self.is_away:
            self.output.run(now)
        if self.stage == RUNNING:
            self._keep_in_touch(now)
        elif now >= self._act_at:
            if self.stage == CONNECTING:
                self._hello(now)
            elif self.stage == CREATING:
                self._look(now)
            else:
                self._ask(0x80, now)

    @micropython.native
    def _keep_in_touch(self, now):
        silent = now - self._heard_at
        if silent >= _ASK_AFTER_MS and now >= self._act_at:
            self._ask(_SESSION, now)
        if silent >= _AWAY_AFTER_MS and not self.is_away:
            self.is_away = True
            self._say("the bridge is silent: waiting for it")
        if now >= self._time_at and not self.is_away:
            self._ask_time(now)

    def _ask(self, session, now):
        """Is anybody there, and do you know me?"""
        self._question[0] = session
        self._act_at = now + _LOOK_MS
        self._send(self._question, 16)

    def _ask_time(self, now):
        self._time_at = now + _RETRY_MS
        self._asked = (self._clock.s, self._clock.us * 1000)
        message = pack("<BBHBBHiI", _SESSION, 0, 0, 14, 1, 8, *self._asked)
        self._send(message, 16)

    def _time(self, data, at, now):
        """TIMESTAMP_REPLY; a late one is worse than none, and asked for again."""
        theirs_s, theirs_ns = unpack_from("<iI", data, at)
        sent_s, sent_ns = unpack_from("<iI", data, at + 16)
        if (sent_s, sent_ns) != self._asked or theirs_s < 0:
            return
        took_ms = now - (sent_s * 1000 + sent_ns // 1000000)
        if took_ms > _LATE_REPLY_MS and self._clock.is_set:
            return
        self._clock.set(sent_s, sent_ns // 1000, theirs_s, theirs_ns // 1000)
        self._time_at = now + _TIME_EVERY_MS

"""Time since the board was switched on, and the time of day once the bridge has told it.

Small whole numbers only: a Pico's float is too coarse for a time, and large numbers cost memory.
"""

_SECOND_US = 1000000


class Clock:
    """Counts microseconds that somebody measured.

    Attributes:
        s: Whole seconds since it was made.
        us: Microseconds of the current second.
        is_set: Whether the time of day is known.
    """

    def __init__(self):
        self.s = 0
        self.us = 0
        self.is_set = False
        self._offset_s = 0
        self._offset_us = 0

    def add(self, elapsed_us):
        """Time went on by so much."""
        self.us += elapsed_us
        while self.us >= _SECOND_US:
            self.us -= _SECOND_US
            self.s += 1

    def ms(self):
        """Milliseconds since it was made."""
        return self.s * 1000 + self.us // 1000

    def stamp_s(self):
        """Seconds of the time of day (of the time since power-on as long as that is all there is)."""
        return self.s + self._offset_s + (self.us + self._offset_us) // _SECOND_US

    def stamp_ns(self):
        """Nanoseconds within `stamp_s`."""
        return (self.us + self._offset_us) % _SECOND_US * 1000

    def set(self, sent_s, sent_us, theirs_s, theirs_us):
        """The bridge said what time it was between ``sent`` (our time) and now.

        What a message takes to go and to come is halved.
        """
        way_us = (self.s - sent_s) * _SECOND_US + self.us - sent_us
        offset_us = theirs_us - sent_us - way_us // 2
        self._offset_s = theirs_s - sent_s + offset_us // _SECOND_US
        self._offset_us = offset_us % _SECOND_US
        self.is_set = True

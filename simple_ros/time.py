"""Times and durations as whole nanoseconds: immutable values, no clock.

They follow ROS 2. A `Time` is never negative, a `Duration` may be, and both fit 64 bits with sign. A
time belongs to a kind of clock; times of different kinds are neither ordered nor subtracted, since
their zeros have nothing to do with each other. Arithmetic is exact; a factor with a fraction rounds to
the nearest nanosecond.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Self, overload

from google.protobuf.duration_pb2 import Duration as DurationMsg
from google.protobuf.timestamp_pb2 import Timestamp

from simple_ros.errors import SimpleRosError
from simple_ros.msg import builtin_interfaces

__all__ = [
    "ClockType",
    "ClockTypeMismatch",
    "Duration",
    "NegativeTime",
    "Time",
    "TimeOverflow",
]

_NS = 1_000_000_000
_MAX_NS = 2**63 - 1
_MIN_NS = -(2**63)
_MAX_SEC = 2**31 - 1


class ClockType(Enum):
    """What a time counts from, with the numbers of ROS 2."""

    ROS_TIME = 1
    """Since 1970-01-01 UTC, or what ``/clock`` says if simulated time is in use."""
    SYSTEM_TIME = 2
    """Since 1970-01-01 UTC."""
    STEADY_TIME = 3
    """Since some moment of this computer; never set."""


class ClockTypeMismatch(SimpleRosError, TypeError):
    """Times of two kinds of clock are mixed.

    Attributes:
        left: Clock of the left time.
        right: Clock of the right time.
    """

    def __init__(self, operation: str, left: ClockType, right: ClockType) -> None:
        self.left = left
        self.right = right
        super().__init__(
            f"cannot {operation} times of different clocks ({left.name} and {right.name}); "
            "take both from one clock"
        )


class TimeOverflow(SimpleRosError, OverflowError):
    """A time or duration does not fit its form.

    Attributes:
        nanoseconds: The value.
    """

    def __init__(self, nanoseconds: float, form: str) -> None:
        self.nanoseconds = nanoseconds
        super().__init__(f"{nanoseconds} ns do not fit {form}")


class NegativeTime(SimpleRosError, ValueError):
    """A time would lie before the zero of its clock.

    Attributes:
        nanoseconds: The value.
    """

    def __init__(self, nanoseconds: int) -> None:
        self.nanoseconds = nanoseconds
        super().__init__(f"a time is not negative, but this is {nanoseconds} ns")


@dataclass(frozen=True, slots=True, order=True)
class Duration:
    """A span of time; may be negative.

    Args:
        nanoseconds: Whole nanoseconds.

    Raises:
        TimeOverflow: It does not fit 64 bits (292 years).
    """

    nanoseconds: int = 0

    def __post_init__(self) -> None:
        _check(self.nanoseconds, "a duration")

    @classmethod
    def of(cls, seconds: float = 0, nanoseconds: int = 0) -> Self:
        """A duration from seconds, with fractions, plus nanoseconds.

        Raises:
            ValueError: The seconds are not a finite number.
            TimeOverflow: It does not fit 64 bits.
        """
        return cls(_to_ns(seconds) + nanoseconds)

    @classmethod
    def from_msg(cls, message: DurationMsg | builtin_interfaces.Duration) -> Self:
        """A duration from either message form.

        Raises:
            TimeOverflow: It does not fit 64 bits.
        """
        if isinstance(message, DurationMsg):
            return cls(message.seconds * _NS + message.nanos)
        return cls(message.sec * _NS + message.nanosec)

    def to_msg(self) -> DurationMsg:
        """The form our messages use: both numbers of one sign."""
        sign = -1 if self.nanoseconds < 0 else 1
        seconds, nanos = divmod(abs(self.nanoseconds), _NS)
        return DurationMsg(seconds=sign * seconds, nanos=sign * nanos)

    def to_builtin(self) -> builtin_interfaces.Duration:
        """The form of ROS 2: nanoseconds are added, also to negative seconds.

        Raises:
            TimeOverflow: It does not fit 32 bits of seconds.
        """
        seconds, nanos = divmod(self.nanoseconds, _NS)
        if not -_MAX_SEC - 1 <= seconds <= _MAX_SEC:
            raise TimeOverflow(self.nanoseconds, "builtin_interfaces.Duration")
        return builtin_interfaces.Duration(sec=seconds, nanosec=nanos)

    @property
    def seconds(self) -> float:
        """Seconds, as near as a float comes."""
        return self.nanoseconds / _NS

    def __add__(self, other: Duration) -> Duration:
        if not isinstance(other, Duration):
            return NotImplemented
        return Duration(self.nanoseconds + other.nanoseconds)

    def __sub__(self, other: Duration) -> Duration:
        if not isinstance(other, Duration):
            return NotImplemented
        return Duration(self.nanoseconds - other.nanoseconds)

    def __mul__(self, factor: float) -> Duration:
        if not isinstance(factor, int | float):
            return NotImplemented
        return Duration(_rounded(self.nanoseconds * factor))

    __rmul__ = __mul__

    @overload
    def __truediv__(self, other: Duration) -> float: ...

    @overload
    def __truediv__(self, other: float) -> Duration: ...

    def __truediv__(self, other: Duration | float) -> Duration | float:
        if isinstance(other, Duration):
            return self.nanoseconds / other.nanoseconds
        if not isinstance(other, int | float):
            return NotImplemented
        return Duration(_rounded(self.nanoseconds / other))

    def __neg__(self) -> Duration:
        return Duration(-self.nanoseconds)

    def __abs__(self) -> Duration:
        return Duration(abs(self.nanoseconds))

    def __bool__(self) -> bool:
        return self.nanoseconds != 0

    def __str__(self) -> str:
        return f"{_text(self.nanoseconds)} s"


@dataclass(frozen=True, slots=True)
class Time:
    """A point in time on one kind of clock.

    Equality is False for different kinds; order and subtraction are an error.

    Args:
        nanoseconds: Whole nanoseconds since the clock's zero.
        clock_type: The kind of clock.

    Raises:
        NegativeTime: It lies before zero.
        TimeOverflow: It does not fit 64 bits (the year 2262).
    """

    nanoseconds: int = 0
    clock_type: ClockType = ClockType.ROS_TIME

    def __post_init__(self) -> None:
        _check(self.nanoseconds, "a time")
        if self.nanoseconds < 0:
            raise NegativeTime(self.nanoseconds)

    @classmethod
    def of(
        cls,
        seconds: float = 0,
        nanoseconds: int = 0,
        clock_type: ClockType = ClockType.ROS_TIME,
    ) -> Self:
        """A time from seconds, with fractions, plus nanoseconds.

        Raises:
            ValueError: The seconds are not a finite number, or the time lies before zero.
            TimeOverflow: It does not fit 64 bits.
        """
        return cls(_to_ns(seconds) + nanoseconds, clock_type)

    @classmethod
    def from_msg(
        cls,
        message: Timestamp | builtin_interfaces.Time,
        clock_type: ClockType = ClockType.ROS_TIME,
    ) -> Self:
        """A time from either message form, such as ``header.stamp``.

        Raises:
            NegativeTime: It lies before zero.
            TimeOverflow: It does not fit 64 bits.
        """
        if isinstance(message, Timestamp):
            return cls(message.seconds * _NS + message.nanos, clock_type)
        return cls(message.sec * _NS + message.nanosec, clock_type)

    def to_msg(self) -> Timestamp:
        """The form our messages use."""
        seconds, nanos = divmod(self.nanoseconds, _NS)
        return Timestamp(seconds=seconds, nanos=nanos)

    def to_builtin(self) -> builtin_interfaces.Time:
        """The form of ROS 2.

        Raises:
            TimeOverflow: It does not fit 32 bits of seconds (the year 2038).
        """
        seconds, nanos = divmod(self.nanoseconds, _NS)
        if seconds > _MAX_SEC:
            raise TimeOverflow(self.nanoseconds, "builtin_interfaces.Time")
        return builtin_interfaces.Time(sec=seconds, nanosec=nanos)

    @property
    def seconds(self) -> float:
        """Seconds, as near as a float comes: about 0.2 us in our days."""
        return self.nanoseconds / _NS

    def __add__(self, other: Duration) -> Time:
        if not isinstance(other, Duration):
            return NotImplemented
        return Time(self.nanoseconds + other.nanoseconds, self.clock_type)

    __radd__ = __add__

    @overload
    def __sub__(self, other: Time) -> Duration: ...

    @overload
    def __sub__(self, other: Duration) -> Time: ...

    def __sub__(self, other: Time | Duration) -> Duration | Time:
        if isinstance(other, Time):
            return Duration(self.nanoseconds - self._alike(other, "subtract"))
        if not isinstance(other, Duration):
            return NotImplemented
        return Time(self.nanoseconds - other.nanoseconds, self.clock_type)

    def __lt__(self, other: Time) -> bool:
        if not isinstance(other, Time):
            return NotImplemented
        return self.nanoseconds < self._alike(other, "compare")

    def __le__(self, other: Time) -> bool:
        if not isinstance(other, Time):
            return NotImplemented
        return self.nanoseconds <= self._alike(other, "compare")

    def _alike(self, other: Time, operation: str) -> int:
        if other.clock_type is not self.clock_type:
            raise ClockTypeMismatch(operation, self.clock_type, other.clock_type)
        return other.nanoseconds

    def __bool__(self) -> bool:
        return self.nanoseconds != 0

    def __str__(self) -> str:
        return f"{_text(self.nanoseconds)} s"


def _check(nanoseconds: int, what: str) -> None:
    if not isinstance(nanoseconds, int):
        raise TypeError(
            f"{what} is made of whole nanoseconds, not {nanoseconds!r}; see of(seconds)"
        )
    if not _MIN_NS <= nanoseconds <= _MAX_NS:
        raise TimeOverflow(nanoseconds, "64 bits")


def _to_ns(seconds: float) -> int:
    if isinstance(seconds, int):
        return seconds * _NS
    if not math.isfinite(seconds):
        raise ValueError(f"seconds are a finite number, not {seconds!r}")
    # Apart, so that the fraction keeps all digits the float has.
    whole = math.floor(seconds)
    return whole * _NS + round((seconds - whole) * _NS)


def _rounded(nanoseconds: float) -> int:
    if not math.isfinite(nanoseconds):
        raise TimeOverflow(nanoseconds, "64 bits")
    return round(nanoseconds)


def _text(nanoseconds: int) -> str:
    sign = "-" if nanoseconds < 0 else ""
    seconds, nanos = divmod(abs(nanoseconds), _NS)
    return f"{sign}{seconds}.{nanos:09d}"

"""Values that are written otherwise in a sample than in a message."""

from __future__ import annotations

from typing import Any, Protocol

from simple_ros_firmware_bridge.cdr_run import Impossible

__all__ = ["Convert", "FromTable", "Nanoseconds", "Nothing"]

_SECOND = 10**9


class Convert(Protocol):
    """Between the numbers of a sample and the field of a message."""

    def read(self, holder: Any, name: str, numbers: tuple[Any, ...]) -> None:
        """Put the numbers of a sample into ``holder``."""
        ...

    def write(self, holder: Any, name: str) -> tuple[Any, ...]:
        """The numbers for a sample."""
        ...


class Nanoseconds:
    """A Timestamp, a Duration, or a number of seconds: there seconds, and nanoseconds to add."""

    def read(self, holder: Any, name: str, numbers: tuple[Any, ...]) -> None:
        """As `Convert` says."""
        # Firmware that counts milliseconds often puts more than a second into the nanoseconds.
        more, nanoseconds = divmod(numbers[1], _SECOND)
        seconds = numbers[0] + more
        if name:
            setattr(holder, name, seconds + nanoseconds / _SECOND)
            return
        if seconds < 0 and nanoseconds and holder.DESCRIPTOR.name == "Duration":
            # protobuf wants both of one sign
            seconds, nanoseconds = seconds + 1, nanoseconds - _SECOND
        holder.seconds = seconds
        holder.nanos = nanoseconds

    def write(self, holder: Any, name: str) -> tuple[Any, ...]:
        """As `Convert` says."""
        if name:
            nanoseconds = round(getattr(holder, name) * _SECOND)
        else:
            nanoseconds = holder.seconds * _SECOND + holder.nanos
        return divmod(int(nanoseconds), _SECOND)


class FromTable:
    """Constants with other numbers.

    Args:
        ours: By the number in the sample, the number in the message.
    """

    def __init__(self, ours: tuple[int, ...]) -> None:
        self._ours = ours

    def read(self, holder: Any, name: str, numbers: tuple[Any, ...]) -> None:
        """As `Convert` says."""
        number = numbers[0]
        if not 0 <= number < len(self._ours) or self._ours[number] < 0:
            raise Impossible(f"{name} {number} has no meaning")
        setattr(holder, name, self._ours[number])

    def write(self, holder: Any, name: str) -> tuple[Any, ...]:
        """As `Convert` says."""
        number = getattr(holder, name)
        if number not in self._ours:
            raise Impossible(f"{name} {number} has no meaning in ROS 2")
        return (self._ours.index(number),)


class Nothing:
    """The one octet that stands for a structure without members."""

    def read(self, holder: Any, name: str, numbers: tuple[Any, ...]) -> None:
        """As `Convert` says."""

    def write(self, holder: Any, name: str) -> tuple[Any, ...]:  # noqa: ARG002
        """As `Convert` says."""
        return (0,)

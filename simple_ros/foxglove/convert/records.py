"""Many small messages of one layout, made from the columns of an array.

A protobuf message whose fields are all present has the same bytes every time but for the numbers in
it. So thousands of points cost one array and one parse, and no Python object each.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from itertools import chain
from operator import attrgetter
from typing import Any

import numpy as np
from google.protobuf.message import Message
from numpy.typing import NDArray

__all__ = ["MARKS", "Floats", "Records", "columns"]

Floats = NDArray[np.float64]

MARKS = tuple(float(2**200 + 2**160 * number) for number in range(16))
"""Stand in a template where a column shall go; numbers nobody means."""


class Records:
    """Messages of one layout as elements of a repeated field.

    Args:
        number: Of the field; up to 15.
        template: A message with ``MARKS[0]``, ``MARKS[1]`` ... in some of its ``double`` fields.
    """

    def __init__(self, number: int, template: Message) -> None:
        body = template.SerializeToString()
        size = len(body)
        length = bytes([size]) if size < 128 else bytes([size & 127 | 128, size >> 7])
        self._record = np.frombuffer(bytes([number << 3 | 2]) + length + body, np.uint8)
        raw = self._record.tobytes()
        places = [raw.find(struct.pack("<d", mark)) for mark in MARKS]
        offsets = [place for place in places if place >= 0]
        self._columns = np.dtype(
            {
                "names": [str(index) for index in range(len(offsets))],
                "formats": ["<f8"] * len(offsets),
                "offsets": offsets,
                "itemsize": len(raw),
            }
        )

    def serialised(self, values: Floats) -> bytes:
        """The field with an element for each row of ``values``, one column per mark."""
        rows = np.empty((len(values), self._record.size), np.uint8)
        rows[:] = self._record
        fields: NDArray[Any] = rows.view(self._columns)[:, 0]
        for index, name in enumerate(self._columns.names or ()):
            fields[name] = values[:, index]
        return rows.tobytes()


def columns(messages: Iterable[Message], count: int, *fields: str) -> Floats:
    """Number fields of many messages, shape (count, fields).

    Args:
        messages: So many as ``count`` says.
        count: Number of rows.
        fields: Names, with dots for parts of parts; at least two.
    """
    numbers = chain.from_iterable(map(attrgetter(*fields), messages))
    return np.fromiter(numbers, np.float64, count * len(fields)).reshape(count, len(fields))

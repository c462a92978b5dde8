"""Messages of several bags together, in the order of time."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from itertools import islice

from simple_ros.bag.messages import BagMessage
from simple_ros.bag.reader import Bag

__all__ = ["in_order"]


def in_order(
    bags: Sequence[Bag], read: Callable[[Bag], Iterator[BagMessage]]
) -> Iterator[tuple[Bag, BagMessage]]:
    """Messages of several bags in the order of time; a bag is read only when its time has come.

    Args:
        bags: The bags.
        read: Begins to read one, in the order of time.
    """
    waiting = sorted(bags, key=lambda bag: bag.start_ns, reverse=True)
    heads: list[tuple[int, int, BagMessage, Bag, Iterator[BagMessage]]] = []
    count = 0
    while waiting or heads:
        while waiting and (not heads or waiting[-1].start_ns <= heads[0][0]):
            bag = waiting.pop()
            messages = read(bag)
            count += 1
            for first in islice(messages, 1):
                heapq.heappush(heads, (first.log_time, count, first, bag, messages))
        if not heads:
            continue
        _, order, message, bag, messages = heads[0]
        yield bag, message
        following = next(messages, None)
        if following is None:
            heapq.heappop(heads)
        else:
            heapq.heapreplace(heads, (following.log_time, order, following, bag, messages))

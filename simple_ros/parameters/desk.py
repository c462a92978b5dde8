"""What answers the calls of `ParameterService`: the Master's, and the one of its double for tests.

Thin shell around `ParameterTree`. A group of values is first offered to the live nodes that declared
any of them, over their leases; if all of them accept in time, it is set as a whole.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from simple_ros.errors import InvalidName
from simple_ros.names import canonical, parameter_name
from simple_ros.parameters.convert import (
    declaration_from_proto,
    description_to_proto,
    parameters_from_proto,
    parameters_to_proto,
    problem_of,
)
from simple_ros.parameters.errors import (
    ParameterConflict,
    ParameterError,
    ParameterRefused,
    unknown,
)
from simple_ros.parameters.feed import ParameterFeed
from simple_ros.parameters.tree import Change, ParameterTree
from simple_ros.parameters.values import Value
from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc import parameters_pb2 as par

__all__ = ["ANSWER_WITHIN_S", "ParameterDesk"]

ANSWER_WITHIN_S = 2.0
"""How long the nodes that declared a parameter may think about a new value, in seconds."""

Lease = Hashable
Response = TypeVar("Response")


@dataclass(slots=True)
class _Offer:
    """One node is being asked."""

    lease: Lease
    owner: str
    names: list[str]
    answer: asyncio.Future[par.ParameterAnswer | None]


class ParameterDesk:
    """The tree of parameters, its watchers and its owners.

    Args:
        send: Says something on a lease.

    Attributes:
        tree: To read.
        on_changed: Called after every group of changes.
    """

    def __init__(self, send: Callable[[Any, master.LeaseEvent], None]) -> None:
        self.tree = ParameterTree()
        self.on_changed: Callable[[], None] = lambda: None
        self._send = send
        self._leases: dict[str, Lease] = {}
        self._offers: dict[int, _Offer] = {}
        self._last_offer = 0
        self._watchers: dict[ParameterFeed, asyncio.Event] = {}
        self._setting = asyncio.Lock()

    # -- looking -------------------------------------------------------------------------------

    def get(self, request: par.GetParametersRequest) -> par.GetParametersResponse:
        """Values of parameters and groups."""
        found: dict[str, Value] = {}
        for name in request.names:
            inside = self.tree.values(canonical(name))
            if not inside:
                error = unknown(canonical(name), self.tree.values())
                return par.GetParametersResponse(problem=problem_of(error))
            found |= inside
        return par.GetParametersResponse(parameters=parameters_to_proto(found))

    def list_names(self, request: par.ListParametersRequest) -> par.ListParametersResponse:
        """Names of a group."""
        return par.ListParametersResponse(names=self.tree.within(canonical(request.prefix)))

    def describe(self, request: par.DescribeParametersRequest) -> par.DescribeParametersResponse:
        """All that is known of a parameter or a group."""
        prefix = canonical(request.prefix)
        found = self.tree.within(prefix)
        if prefix and not found:
            error = unknown(prefix, self.tree.values())
            return par.DescribeParametersResponse(problem=problem_of(error))
        described = [description_to_proto(name, entry) for name, entry in found.items()]
        return par.DescribeParametersResponse(parameters=described)

    @contextmanager
    def watching(self, prefix: str) -> Iterator[tuple[ParameterFeed, asyncio.Event]]:
        """News of a group, and a signal that is set whenever there are more."""
        feed, news = ParameterFeed(self.tree, canonical(prefix)), asyncio.Event()
        self._watchers[feed] = news
        try:
            yield feed, news
        finally:
            del self._watchers[feed]

    # -- changing ------------------------------------------------------------------------------

    async def set(self, request: par.SetParametersRequest) -> par.SetParametersResponse:
        """Set a group, if it is right and all who declared any of it accept."""
        try:
            async with self._setting:
                values = parameters_from_proto(request.parameters)
                planned = self.tree.plan(values)
                await self._ask_owners(planned, canonical(request.node_info.node_name))
                # Nodes may have come and gone meanwhile.
                planned = self.tree.plan(values)
                self._tell(self.tree.set(planned), planned)
        except (ParameterError, InvalidName) as error:
            return par.SetParametersResponse(problem=problem_of(error))
        return par.SetParametersResponse(
            revision=self.tree.revision, parameters=parameters_to_proto(planned)
        )

    async def delete(self, request: par.DeleteParametersRequest) -> par.DeleteParametersResponse:
        """Delete parameters and groups that no other live node declares."""
        try:
            async with self._setting:
                changes = self.tree.delete(request.names, canonical(request.node_info.node_name))
                self._tell(changes)
        except (ParameterError, InvalidName) as error:
            return par.DeleteParametersResponse(problem=problem_of(error))
        return par.DeleteParametersResponse(names=[change.name for change in changes])

    def load(self, values: Mapping[str, Value]) -> None:
        """Set what an earlier Master kept. Raises as `ParameterTree.set`."""
        self.tree.set(values)

    # -- owners --------------------------------------------------------------------------------

    def declare(
        self, request: par.DeclareParametersRequest, lease: Lease | None
    ) -> par.DeclareParametersResponse:
        """The node of a lease declares parameters; None if it holds no lease."""
        owner = canonical(request.node_info.node_name)
        try:
            if lease is None:
                name = request.declarations[0].parameter.name if request.declarations else ""
                raise ParameterConflict(name, f"node {owner!r} that declares it holds no lease")
            if self._leases.get(owner, lease) != lease:
                self._tell(self.tree.release(owner))
            self._leases[owner] = lease
            declared = [declaration_from_proto(item) for item in request.declarations]
            changes = self.tree.declare(owner, declared)
        except (ParameterError, InvalidName) as error:
            return par.DeclareParametersResponse(problem=problem_of(error))
        self._tell(changes, {item.name: None for item in changes if item.value is not None})
        names = [parameter_name(item.name) for item in declared]
        return par.DeclareParametersResponse(
            revision=self.tree.revision,
            parameters=[description_to_proto(name, self.tree.entry(name)) for name in names],
        )

    def lease_ended(self, lease: Lease) -> None:
        """A node is gone, and with it what it declared."""
        for owner in [owner for owner, held in self._leases.items() if held == lease]:
            del self._leases[owner]
            self._tell(self.tree.release(owner))
        for offer in self._offers.values():
            if offer.lease == lease and not offer.answer.done():
                offer.answer.set_result(None)

    def answered(self, lease: Lease, answer: par.ParameterAnswer) -> None:
        """A node that was asked says something; late answers are nobody's matter any more."""
        offer = self._offers.get(answer.id)
        if offer is not None and offer.lease == lease and not offer.answer.done():
            offer.answer.set_result(answer)

    async def _ask_owners(self, planned: dict[str, Value], asker: str) -> None:
        """Offer values to everybody who declared any of them, but not to who wants to set them.

        Raises:
            ParameterRefused: One of them refuses, or does not answer in time.
        """
        asked = []
        for owner, names in self.tree.owners_of(planned).items():
            if owner != asker:
                asked.append(self._offer(owner, {name: planned[name] for name in names}))
        if not asked:
            return
        try:
            await asyncio.wait(
                [self._offers[number].answer for number in asked], timeout=ANSWER_WITHIN_S
            )
        finally:
            offers = [self._offers.pop(number) for number in asked]
        for offer in offers:
            _check_answer(offer)

    def _offer(self, owner: str, values: dict[str, Value]) -> int:
        self._last_offer += 1
        number, lease = self._last_offer, self._leases[owner]
        future = asyncio.get_running_loop().create_future()
        self._offers[number] = _Offer(lease, owner, list(values), future)
        offer = par.ParameterOffer(id=number, parameters=parameters_to_proto(values))
        self._send(lease, master.LeaseEvent(parameter_offer=offer))
        return number

    # -- telling -------------------------------------------------------------------------------

    def _tell(
        self, changes: list[Change], planned: Mapping[str, Value | None] | None = None
    ) -> None:
        """Tell watchers what changed, and owners what is set."""
        for feed, news in self._watchers.items():
            if feed.add(changes):
                news.set()
        for owner, names in self.tree.owners_of(planned or ()).items():
            values = {name: self.tree.entry(name).value for name in names}
            said = par.ParametersSet(
                revision=self.tree.revision, parameters=parameters_to_proto(values)
            )
            self._send(self._leases[owner], master.LeaseEvent(parameters_set=said))
        if changes:
            self.on_changed()


def _check_answer(offer: _Offer) -> None:
    name = offer.names[0]
    if not offer.answer.done():
        offer.answer.cancel()
        reason = f"node {offer.owner!r} declared it and did not answer within {ANSWER_WITHIN_S:g} s"
        raise ParameterRefused(name, reason)
    answer = offer.answer.result()
    if answer is not None and not answer.accepted:
        of = f" (with {', '.join(map(repr, offer.names[1:]))})" if offer.names[1:] else ""
        raise ParameterRefused(name, f"node {offer.owner!r} refuses{of}: {answer.reason}")

"""Provide a service: what the handler returns is the answer, what it raises is raised at the client."""

from simple_ros import aio
from simple_ros.msg.example_interfaces import AddTwoInts, AddTwoIntsRequest, AddTwoIntsResponse


def add(request: AddTwoIntsRequest) -> AddTwoIntsResponse:
    if request.a < 0 or request.b < 0:
        raise ValueError("no negative numbers")
    return AddTwoIntsResponse(sum=request.a + request.b)


async def main() -> None:
    async with aio.NodeHandle("adder") as node:
        await node.advertise_service("add", AddTwoInts, add)
        await node.spin()


aio.run(main())

"""Call a service: wait for it, many calls at a time, a deadline, and an error of the other side."""

import asyncio

from simple_ros import RemoteServiceError, ServiceTimeout, aio
from simple_ros.msg.example_interfaces import AddTwoInts, AddTwoIntsRequest


async def main() -> None:
    async with aio.NodeHandle("asker") as node:
        add = node.service_client("add", AddTwoInts, timeout=2.0)
        await add.wait_for_service()

        answer = await add.call(AddTwoIntsRequest(a=2, b=3))
        print(f"2 + 3 = {answer.sum}")

        answers = await asyncio.gather(*(add.call(AddTwoIntsRequest(a=i, b=i)) for i in range(5)))
        print(f"doubled: {[answer.sum for answer in answers]}")

        try:
            await add.call(AddTwoIntsRequest(a=-1))
        except RemoteServiceError as error:
            print(f"it raised {error.type}: {error.message}")
        except ServiceTimeout:
            print("no answer within 2 s")


aio.run(main())

"""``simple-ros tf echo``."""

from __future__ import annotations

import asyncio
import math
import sys
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.options import CountOption, JsonOption, MasterOption
from simple_ros.cli.text import json_line, say
from simple_ros.cli.topic.following import cli_node, while_running

if TYPE_CHECKING:
    from simple_ros.msg.geometry_msgs import TransformStamped
    from simple_ros.tf.buffer import Buffer

__all__ = ["echo"]

_SAY_AFTER_S = 1.0

ParentArgument = Annotated[str, typer.Argument(metavar="PARENT", help="Frame it is seen from.")]
ChildArgument = Annotated[str, typer.Argument(metavar="CHILD", help="Frame whose pose is wanted.")]


def echo(
    parent: ParentArgument,
    child: ChildArgument,
    count: CountOption = None,
    rate: Annotated[float, typer.Option(min=0.01, help="How often a second.")] = 1.0,
    timeout: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.0, help="How long to wait for the first.")
    ] = 5.0,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print where CHILD stands in PARENT, once a second, until Ctrl-C.

    Exit code 1 if it is not known within the timeout.
    """
    from simple_ros import aio

    aio.run(_echo(parent, child, count, rate, timeout, json, master))


async def _echo(
    parent: str,
    child: str,
    count: int | None,
    rate_hz: float,
    timeout_s: float,
    json: bool,
    master: str | None,
) -> None:
    from simple_ros.tf.nodes import TransformListener

    async with cli_node("tf", master) as node:
        buffer = (await TransformListener.create(node)).buffer

        async def follow() -> None:
            answer = await _first(buffer, parent, child, timeout_s)
            left = count
            while True:
                _say_transform(answer, json)
                if left is not None and (left := left - 1) == 0:
                    return
                await asyncio.sleep(1.0 / rate_hz)
                answer = _latest(buffer, parent, child, answer)

        await while_running(node, follow())


async def _first(buffer: Buffer, parent: str, child: str, timeout_s: float) -> TransformStamped:
    """Wait for the transform, and say for what if that takes long."""
    from simple_ros.tf.errors import TransformTimeout

    if timeout_s > _SAY_AFTER_S:
        try:
            return await buffer.wait_for_transform(parent, child, timeout=_SAY_AFTER_S)
        except TransformTimeout as error:
            print(f"waiting: {error.reason}", file=sys.stderr)
    else:
        return await buffer.wait_for_transform(parent, child, timeout=timeout_s)
    try:
        return await buffer.wait_for_transform(parent, child, timeout=timeout_s - _SAY_AFTER_S)
    except TransformTimeout as error:
        raise TransformTimeout(timeout_s, error.reason) from None


def _latest(buffer: Buffer, parent: str, child: str, before: TransformStamped) -> TransformStamped:
    from simple_ros.tf.errors import TransformError

    try:
        return buffer.lookup_transform(parent, child)
    except TransformError as error:
        print(f"warning: {error}", file=sys.stderr)
        return before


def _say_transform(answer: TransformStamped, json: bool) -> None:
    from simple_ros.tf.rigid import from_message
    from simple_ros.time import Time

    rigid, stamp = from_message(answer.transform), Time.from_msg(answer.header.stamp)
    # Adding zero makes 0 of -0.
    rpy = [round(math.degrees(angle), 9) + 0.0 for angle in rigid.rpy()]
    if json:
        say(
            json_line(
                {
                    "parent": answer.header.frame_id,
                    "child": answer.child_frame_id,
                    "stamp_ns": stamp.nanoseconds,
                    "translation": list(rigid.translation),
                    "rotation": list(rigid.rotation),
                    "rpy_deg": rpy,
                }
            )
        )
        return
    at = f"at {stamp}" if stamp else "static"
    say(
        f"{answer.child_frame_id} in {answer.header.frame_id}, {at}\n"
        f"  translation  x {_number(rigid.translation[0])}  y {_number(rigid.translation[1])}"
        f"  z {_number(rigid.translation[2])} m\n"
        f"  rotation     x {_number(rigid.rotation[0])}  y {_number(rigid.rotation[1])}"
        f"  z {_number(rigid.rotation[2])}  w {_number(rigid.rotation[3])}\n"
        f"  roll, pitch, yaw  {rpy[0]:.2f}, {rpy[1]:.2f}, {rpy[2]:.2f} deg"
    )


def _number(value: float) -> str:
    # Adding zero makes 0 of -0.
    return f"{round(value, 4) + 0.0:.4f}"

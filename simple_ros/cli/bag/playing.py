"""``simple-ros bag play``."""

from __future__ import annotations

import asyncio
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.bag.arguments import ExcludeOption, RegexOption, bag_files, counted, remaps_of
from simple_ros.cli.options import MasterOption
from simple_ros.cli.text import put, say

if TYPE_CHECKING:
    from simple_ros.bag import Bag, Player, PlayOptions

__all__ = ["play"]

_JUMP_S = 5.0
_FASTER = 1.1
_STATUS_S = 0.2


def play(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help="Bags, or a directory with the files of one."),
    ],
    rate: Annotated[
        float, typer.Option("-r", "--rate", min=0.001, help="Twice as fast is 2.")
    ] = 1.0,
    loop: Annotated[bool, typer.Option("-l", "--loop", help="Begin again at the end.")] = False,
    topics: Annotated[
        list[str] | None, typer.Option("-t", "--topic", metavar="TOPIC", help="Only this topic.")
    ] = None,
    regex: RegexOption = None,
    exclude: ExcludeOption = None,
    remap: Annotated[
        list[str] | None,
        typer.Option("-m", "--remap", metavar="OLD:=NEW", help="Publish a topic by another name."),
    ] = None,
    start: Annotated[
        float, typer.Option("-s", "--start-offset", metavar="S", min=0, help="Begin in the middle.")
    ] = 0.0,
    duration: Annotated[
        float | None,
        typer.Option(
            "--playback-duration", metavar="S", min=0.001, help="End after so much of the bag."
        ),
    ] = None,
    clock: Annotated[bool, typer.Option("--clock", help="Publish /clock.")] = False,
    clock_rate: Annotated[
        float, typer.Option("--clock-rate", metavar="HZ", min=0.001, help="How often.")
    ] = 40.0,
    delay: Annotated[
        float, typer.Option("-d", "--delay", metavar="S", min=0, help="Wait before the start.")
    ] = 0.0,
    paused: Annotated[
        bool, typer.Option("-p", "--start-paused", help="Begin when space is pressed.")
    ] = False,
    master: MasterOption = None,
) -> None:
    """Publish what was recorded, at the pace at which it was recorded.

    Types need not be installed. In a terminal: space pauses, the right arrow steps (paused) or jumps
    5 s, the left arrow jumps back, up and down change the rate.
    """
    from simple_ros import aio
    from simple_ros.bag import Bag, PlayOptions, TopicSelection

    everything = not topics and regex is None
    selection = TopicSelection.made(topics or (), every=everything, pattern=regex, exclude=exclude)
    options = PlayOptions(
        rate=rate,
        loop=loop,
        wants=selection.wants,
        remap=remaps_of(remap or ()),
        start_offset_s=start,
        duration_s=duration,
        clock_hz=clock_rate if clock else None,
        delay_s=delay,
        paused=paused,
    )
    # The thread that reads ahead shares the interpreter with the loop that publishes.
    sys.setswitchinterval(0.0005)
    with ExitStack() as stack:
        bags = [stack.enter_context(Bag(path)) for path in bag_files(files)]
        aio.run(_play(bags, options, master))


async def _play(bags: list[Bag], options: PlayOptions, master: str | None) -> None:
    from simple_ros.bag import Player
    from simple_ros.cli.topic.following import cli_node, while_running
    from simple_ros.net.master_client import MasterClient

    async with MasterClient(master) as client:
        await client.get_topics()  # a node would wait for its Master; here its absence is told
    async with cli_node("bag_play", master) as node:
        player = Player(node, bags, options)
        await player.open()
        for name, reason in player.skipped.items():
            print(f"warning: {name!r} is not played: {reason}", file=sys.stderr)
        say(f"playing {', '.join(player.topics)}")
        try:
            await while_running(node, _follow(player))
        finally:
            say(f"published {counted(player.published)}")
            if player.dropped:
                lost = counted(player.dropped)
                print(f"warning: {lost} dropped: a subscriber was too slow", file=sys.stderr)


async def _follow(player: Player) -> None:
    from simple_ros.cli.bag.keyboard import DOWN, LEFT, RIGHT, SPACE, UP, keys_do

    def toggle() -> None:
        (player.resume if player.is_paused else player.pause)()

    def forward() -> None:
        if player.is_paused:
            player.step()
        else:
            player.seek(player.position_s + _JUMP_S)

    actions = {
        SPACE: toggle,
        RIGHT: forward,
        LEFT: lambda: player.seek(player.position_s - _JUMP_S),
        UP: lambda: player.set_rate(player.rate * _FASTER),
        DOWN: lambda: player.set_rate(player.rate / _FASTER),
    }
    with keys_do(actions) as has_keyboard:
        status = asyncio.create_task(_status(player, shown=has_keyboard))
        try:
            await player.run()
        finally:
            status.cancel()
            await asyncio.gather(status, return_exceptions=True)
            if has_keyboard:
                put("\n")


async def _status(player: Player, *, shown: bool) -> None:
    while shown and sys.stdout.isatty():
        state = "paused" if player.is_paused else f"rate {player.rate:.2f}"
        put(f"\r{player.position_s:8.1f} of {player.end_s:.1f} s, {state}  \x1b[K")
        await asyncio.sleep(_STATUS_S)

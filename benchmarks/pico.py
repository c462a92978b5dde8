"""The Pico bridge on a pseudo terminal, in one command: ``python benchmarks/pico.py [NAME ...]``.

``computing`` what the agent computes for a sample, with nobody to wait for
``clean``     a clean line: loss, load, latency beside a process that only copies the bytes
``flips``     a bad cable: 1 % of 42-byte chunks with a flipped bit, cmd_vel at 20 and 100 Hz
``loss``      5 % of messages lost each way; boards 20 times slower in simulated time
``restart``   the bridge killed with -9
``garbage``   three million seeded bytes of garbage
``hardware``  the hardware interface's read and write
``loop``      from cmd_vel through the controller to the motors

The board is simulated in this process; Master, bridge and controller are processes of their own. A computer of two cores
has enough for it when nothing else runs. What else runs shows in the latencies, in the bare ones too, and in how late
this process wakes up, which is told for each run.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import harness
import pico_computing
import pico_control
import pico_lines
from pico_tools import Lag, Place, Row

RUNS = {
    "computing": pico_computing.computing,
    "clean": pico_lines.clean,
    "flips": pico_lines.flips,
    "loss": pico_lines.loss,
    "restart": pico_lines.restart,
    "garbage": pico_lines.garbage,
    "hardware": pico_control.hardware,
    "loop": pico_control.loop,
}
_QUICK_S = 10.0


def line(row: Row) -> str:
    verdict = ("ok" if row.is_met else "MISSED") if row.bar else ""
    return f"  {row.what:<72}{row.value:>10.2f} {row.unit:<10}{row.bar:>8}  {verdict}".rstrip()


async def measured(names: list[str], seconds: float) -> dict[str, list[Row]]:
    results = {}
    with harness.master() as address:
        for name in names:
            with tempfile.TemporaryDirectory() as state:
                place = Place(address, Path(state), seconds, min(seconds, 20.0))
                lag = Lag()
                results[name] = [*await RUNS[name](place), *lag.rows()]
            print(f"{name}:", *map(line, results[name]), sep="\n", flush=True)
    return results


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="default: all")
    parser.add_argument("--seconds", type=float, default=60.0, help="of the long runs (60)")
    parser.add_argument("--quick", action="store_true", help=f"long runs of {_QUICK_S:g} s")
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    unknown = [name for name in args.names if name not in RUNS]
    if unknown:
        parser.error(f"unknown: {', '.join(unknown)}; there are {', '.join(RUNS)}")
    seconds = _QUICK_S if args.quick else args.seconds
    print(f"{harness.machine()}; long runs of {seconds:g} s")
    results = asyncio.run(measured(args.names or list(RUNS), seconds))
    missed = [row for rows in results.values() for row in rows if not row.is_met]
    print(f"bars missed: {len(missed)}", *(f"  {row.what}" for row in missed), sep="\n")
    if args.json:
        content = {name: [asdict(row) for row in rows] for name, rows in results.items()}
        whole = {"machine": harness.machine(), "seconds": seconds, "results": content}
        args.json.write_text(json.dumps(whole, indent=2) + "\n")
        print(f"written: {args.json}", file=sys.stderr)


if __name__ == "__main__":
    main()

"""Service calls measured: ``python benchmarks/services.py [KIND ...] [--runs N] [--json FILE]``.

Two processes over loopback, ``std_srvs.SetBool``: calls one after another, calls at 1 kHz, and 100 at a
time. Ours beside a bare asyncio program with the same messages and beside the nearest peers of other
projects that are installed here (see ``service_peers.py``); those that are not are left out, with the
reason. The peers take turns, round after round.

Where the scheduler puts two processes changes a round trip up to fourfold, so they are pinned: ``--place
apart`` (a core each, the default) or ``together`` (one core), ``free`` to see what chance makes of it.

``ROS1_PYTHON`` names the Python that has rospy (``/usr/bin/python3`` if unset; Debian: ``apt-get install
python3-rospy python3-rosmaster python3-std-srvs``). Builds of CPython differ by half: compare with rospy only
when this program runs under that same Python; the first line says which ones run.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import harness

KINDS = ["ours", "blocking", "bare", "zmq", "zenoh", "grpc", "rospy"]
NEEDS = {"zmq": ("zmq", "pyzmq"), "zenoh": ("zenoh", "eclipse-zenoh")}
COUNT = 4_000
PACED = 1_000
PIPELINED = 20_000
FREE = (None, None)
PLACES = {"apart": (0, 1), "together": (0, 0), "free": FREE}
"""Cores of server and client."""
ROS1_PYTHON = os.environ.get("ROS1_PYTHON", "/usr/bin/python3")


def missing(kind: str) -> str:
    """Why a kind cannot be measured here; empty if it can."""
    if kind == "rospy":
        found = subprocess.run(
            [ROS1_PYTHON, "-c", "import rospy, std_srvs.srv"], capture_output=True, check=False
        )
        if found.returncode or shutil.which("rosmaster") is None:
            return f"{ROS1_PYTHON} has no rospy, or there is no rosmaster"
    elif kind in NEEDS and importlib.util.find_spec(NEEDS[kind][0]) is None:
        return f"pip install {NEEDS[kind][1]}"
    return ""


def interpreters() -> str:
    same = Path(sys.executable).resolve() == Path(ROS1_PYTHON).resolve()
    return f"Python {sys.executable}, rospy by {'the same' if same else ROS1_PYTHON}"


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        return int(listening.getsockname()[1])


@contextmanager
def started(
    command: list[str], environment: dict[str, str], core: int | None = None
) -> Iterator[subprocess.Popen[str]]:
    if core is not None:
        command = ["taskset", "-c", str(core), *command]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=os.environ | environment,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait(5)


def one_run(
    kind: str, master: str, ros_master: str, cores: tuple[int | None, int | None] = FREE
) -> dict[str, Any]:
    """One server, one client; the client's report."""
    if kind == "rospy":
        peer = [ROS1_PYTHON, str(harness.HERE / "rospy_peer.py")]
        server, client = [*peer, "server"], [*peer, "client", str(COUNT), str(PACED)]
    else:
        peer = [sys.executable, str(harness.HERE / "service_peers.py"), kind]
        port = str(free_port()) if kind == "zenoh" else ""
        server = [*peer, "server", "--master", master, "--at", port]
        client = [*peer, "client", "--master", master]
        client += ["--count", str(COUNT), "--paced", str(PACED), "--pipelined", str(PIPELINED)]
    environment = {"ROS_MASTER_URI": ros_master, "ROS_IP": "127.0.0.1"}
    with started(server, environment, cores[0]) as answering:
        assert answering.stdout is not None
        at = json.loads(answering.stdout.readline())["ready"]
        command = client if kind == "rospy" else [*client, "--at", str(at)]
        with started(command, environment, cores[1]) as asking:
            output, _ = asking.communicate(timeout=harness.LIMIT_S)
    if asking.returncode:
        raise SystemExit(f"the client of {kind} failed")
    report: dict[str, Any] = json.loads(output.splitlines()[-1])
    return report


@contextmanager
def ros_master(wanted: bool) -> Iterator[str]:
    """A Master of ROS 1, if it is wanted; its URI."""
    port = free_port()
    uri = f"http://127.0.0.1:{port}"
    if not wanted:
        yield uri
        return
    with started(["rosmaster", "--core", "-p", str(port)], {"ROS_MASTER_URI": uri}):
        end = time.monotonic() + 10
        while time.monotonic() < end:
            try:
                socket.create_connection(("127.0.0.1", port)).close()
                break
            except OSError:
                time.sleep(0.05)
        yield uri


def measure(runs: int, wanted: list[str] | None = None, place: str = "apart") -> dict[str, Any]:
    kinds, table = [], []
    for kind in wanted or KINDS:
        reason = missing(kind)
        if reason:
            table.append(f"  {kind:<9} left out: {reason}")
        else:
            kinds.append(kind)
    rounds: dict[str, list[dict[str, Any]]] = {kind: [] for kind in [*kinds, "free", "topic"]}
    with harness.master() as master, ros_master("rospy" in kinds) as uri:
        for _ in range(runs):
            for kind in kinds:
                rounds[kind].append(one_run(kind, master, uri, PLACES[place]))
                print(".", end="", flush=True, file=sys.stderr)
            # The programs of the topic are not pinned: neither is what they are compared with.
            rounds["free"].append(one_run("ours", master, uri))
            rounds["topic"] += harness.one_run("ours", PACED, 1000, master)
    print(file=sys.stderr)
    table += [_row(kind, rounds[kind]) for kind in kinds]
    found: dict[str, Any] = {
        kind: {field: harness.median(rounds[kind], field) for field in rounds[kind][0]}
        for kind in rounds
    }
    found["ratios"] = _ratios(kinds, rounds) if "ours" in kinds else {}
    table += [f"  {name:<38}{_shown(ratio)}" for name, ratio in found["ratios"].items()]
    return {"table": [HEAD, *table], **found}


HEAD = "            calls/s  p50 us  p99 us   1 kHz: p50 us  p99 us   100 at a time"


def _row(kind: str, reports: list[dict[str, Any]]) -> str:
    def of(field: str) -> float:
        return harness.median(reports, field)

    pipelined = (
        f"{of('pipelined_per_second'):10,.0f}/s" if "pipelined_per_second" in reports[0] else ""
    )
    return (
        f"  {kind:<9}{of('per_second'):8,.0f} {of('sequential_p50_us'):7.0f} "
        f"{of('sequential_p99_us'):7.0f}   {of('paced_p50_us'):13.0f} {of('paced_p99_us'):7.0f} "
        f"  {pipelined}".rstrip()
    )


def _ratios(
    kinds: list[str], rounds: dict[str, list[dict[str, Any]]]
) -> dict[str, tuple[float, float, float]]:
    ours = rounds["ours"]
    found = {
        f"calls/s, ours / {kind}": harness.paired_ratio(ours, rounds[kind], "per_second")
        for kind in kinds
        if kind != "ours"
    }
    found |= {
        f"100 at a time, ours / {kind}": harness.paired_ratio(
            ours, rounds[kind], "pipelined_per_second"
        )
        for kind in kinds
        if kind not in ("ours", "rospy")
    }
    topics = [{"paced_p50_us": report["p50_us"]} for report in rounds["topic"]]
    found["p50 at 1 kHz / one-way topic latency"] = harness.paired_ratio(
        rounds["free"], topics, "paced_p50_us"
    )
    return found


def _shown(ratio: tuple[float, float, float]) -> str:
    least, middle, most = ratio
    return f"{middle:5.2f} ({least:.2f} to {most:.2f})"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("kinds", nargs="*", metavar="KIND", help="default: all that are here")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--place", choices=PLACES, default="apart")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    unknown = set(args.kinds) - set(KINDS)
    if unknown:
        parser.error(f"unknown: {', '.join(unknown)}; there are {', '.join(KINDS)}")
    print(f"{harness.machine()}, processes {args.place}, {interpreters()}")
    found = measure(args.runs, args.kinds, args.place)
    print(*found.pop("table"), sep="\n")
    if args.json:
        args.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()

"""The measurements run: processes of ours and the bare ones, lost messages, failures, the command."""

from __future__ import annotations

import json
import sys
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path

import pytest
from support.cli import run
from support.processes import master_process, python

from simple_ros.benchmark.calling import OWN_CALLERS, one_call_run
from simple_ros.benchmark.calls import Calls
from simple_ros.benchmark.peers import LIMITS, OURS, Peer
from simple_ros.benchmark.running import RunFailed, one_run
from simple_ros.benchmark.session import Extent, measure
from simple_ros.benchmark.workloads import WORKLOADS, Workload

RIVALS = Path(__file__).parents[2] / "benchmarks" / "rivals"
COUNT = 20
SHORT = Calls(count=20, paced=10, pipelined=40, window=20)


def short(name: str) -> Workload:
    whole = WORKLOADS[name]
    size = min(whole.size_bytes, 200_000)
    return replace(whole, count=COUNT, receivers=min(2, whole.receivers), size_bytes=size)


@pytest.fixture
async def services() -> AsyncIterator[dict[str, str]]:
    async with master_process() as (_, address):
        yield {"master": address}


def program(text: str) -> Peer:
    return Peer("other", "rival", "another", (sys.executable, "-c", text))


@pytest.mark.parametrize(
    ("name", "workload"),
    [
        ("ours", "small"),
        ("ours_unix", "latency"),
        ("ours_blocking", "small"),
        ("ours", "image30"),
        ("ours_inside", "mib"),
        ("ours", "fanout"),
    ],
)
async def test_ours(name: str, workload: str, services: dict[str, str]) -> None:
    found = await one_run(OURS[name], short(workload), services)
    assert found["lost"] == found["repeated"] == 0
    assert found["received"] == COUNT * short(workload).receivers
    assert found["first_ms"] > 0
    assert found["cpu_us"] > 0
    assert found["per_second"] > 0


@pytest.mark.parametrize(
    ("name", "workload"),
    [
        ("streams", "small"),
        ("buffered", "fanout"),
        ("buffered_unix", "latency"),
        ("sockets", "latency"),
        ("tuned", "small"),
        ("tuned", "mib"),
        ("tuned_unix", "image30"),
        ("buffered", "mib"),
    ],
)
async def test_limits(name: str, workload: str) -> None:
    found = await one_run(LIMITS[name], short(workload), {})
    assert found["lost"] == found["repeated"] == 0
    assert ("p50_us" in found) is bool(WORKLOADS[workload].rate_hz)


LOSING = """
import json, sys
from simple_ros.benchmark.payloads import twist_maker
from simple_ros.benchmark.program import ready, run_program
from simple_ros.benchmark.source import drive

def receive(job, sink):
    ready()
    make = twist_maker(job.workload)
    for number in [0, 0, 1, 2, 2, 5, job.workload.count]:
        sink.message(make(number))
    sys.stdin.read()

run_program(receive, lambda job: drive(job.workload, int, lambda number: None))
"""


async def test_what_is_lost_and_repeated_is_counted() -> None:
    found = await one_run(program(LOSING), short("small"), {})
    assert (found["received"], found["lost"], found["repeated"]) == (4, COUNT - 4, 1)


async def test_a_program_that_ends_is_a_failure_with_its_last_words() -> None:
    with pytest.raises(RunFailed, match="the receiver ended: no such luck"):
        await one_run(program("raise SystemExit('no such luck')"), short("small"), {})


async def test_a_program_that_is_not_there() -> None:
    peer = Peer("none", "rival", "none", ("/no/such/program",))
    with pytest.raises(RunFailed, match="the receiver did not start"):
        await one_run(peer, short("small"), {})


@pytest.mark.parametrize("name", OWN_CALLERS)
async def test_calls(name: str, services: dict[str, str]) -> None:
    found = await one_call_run(OWN_CALLERS[name], SHORT, services)
    assert found["per_second"] > 0
    assert found["pipelined_per_second"] > 0
    assert found["paced_p50_us"] <= found["paced_p99_us"]


async def test_a_session_has_all_tables() -> None:
    told: list[str] = []
    extent = Extent(1, 60.0, {"small": 0.001, "latency": 0.02}, SHORT)
    found = await measure(extent, ["unix"], told.append)
    assert found["rounds"] == 1
    assert found["failures"] == []
    assert set(found["tables"]) == {
        "small",
        "latency",
        "first",
        "calls_sequential_p50_us",
        "calls_pipelined_per_second",
    }
    for table in found["tables"].values():
        for row in table["peers"].values():
            assert row["value"]["median"] > 0
    assert set(found["tables"]["small"]["peers"]) == {"ours_unix", "buffered"}
    assert any("latency" in line for line in told)
    json.dumps(found)


async def test_the_command_refuses_an_unknown_transport() -> None:
    code, stdout, stderr = await run("bench", "--transport", "pigeon", TERMINAL_WIDTH="200")
    assert (code, stdout) == (2, "")
    assert "no transport 'pigeon'; there are" in stderr


async def test_rivals_load_none_of_the_library() -> None:
    """What they take from it must not cost them the time that ours takes to be imported."""
    text = (
        "import sys; sys.path.insert(0, sys.argv[1]); import lean\n"
        "import simple_ros.benchmark.program, simple_ros.benchmark.calls\n"
        "from simple_ros.benchmark.payloads import encoder\n"
        "print([name for name in sys.modules if name.startswith('simple_ros.')"
        " and not name.startswith(('simple_ros.benchmark', 'simple_ros.msg'))])"
    )
    async with python("-c", text, str(RIVALS)) as process:
        assert await process.line() == "[]"

"""``simple-ros msg``: list, show and compile message types."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from support.processes import master_process, program, python
from typer.testing import CliRunner

from simple_ros.cli.msg import app

BEACON = """
syntax = "proto3";
package lab;
import "simple_ros/msg/geometry_msgs.proto";
import "google/protobuf/timestamp.proto";
message Beacon {
  geometry_msgs.Pose pose = 1;
  google.protobuf.Timestamp stamp = 2;
  repeated string tags = 3;
}
"""
TALKER = """
    import sys
    sys.path.insert(0, sys.argv[1])
    from beacon_pb2 import Beacon
    from simple_ros import aio

    async def main():
        async with aio.NodeHandle("talker") as node:
            publisher = await node.advertise("beacon", Beacon)
            node.create_timer(0.01, lambda event: publisher.publish(Beacon(tags=["here"])))
            print("ready", flush=True)
            await node.spin()

    aio.run(main())
"""


def run(*words: str) -> str:
    result = CliRunner().invoke(app, list(words), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_list_and_show() -> None:
    assert "geometry_msgs.Twist" in run("list", "Twist").splitlines()
    assert "nav_msgs.Path" in json.loads(run("list", "--json"))
    text = run("show", "nav_msgs/Path")
    assert text.startswith(
        "message nav_msgs.Path {\n  std_msgs.Header header = 1\n"
        "  repeated geometry_msgs.PoseStamped poses = 2\n}\n"
    )
    assert "message geometry_msgs.Quaternion {" in text


def test_compiled_messages_use_the_shipped_ones(tmp_path: Path) -> None:
    pytest.importorskip("grpc_tools")
    (tmp_path / "beacon.proto").write_text(BEACON)
    output = run("compile", str(tmp_path / "beacon.proto"), "--out", str(tmp_path))
    module, stubs = tmp_path / "beacon_pb2.py", tmp_path / "beacon_pb2.pyi"
    assert output == f"made {module} and {stubs}\n"
    assert module.exists()
    assert stubs.exists()


def test_without_the_compiler_its_package_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "grpc_tools", None)
    (tmp_path / "beacon.proto").write_text(BEACON)
    result = CliRunner().invoke(app, ["compile", str(tmp_path / "beacon.proto")])
    assert str(result.exception).endswith(": pip install grpcio-tools")


def test_what_does_not_compile_says_so(tmp_path: Path) -> None:
    pytest.importorskip("grpc_tools")
    (tmp_path / "bad.proto").write_text("syntax = 'proto3'; message Bad { nonsense x = 1; }")
    result = CliRunner().invoke(app, ["compile", str(tmp_path / "bad.proto"), "-o", str(tmp_path)])
    assert "not compiled" in str(result.exception)


async def test_a_type_of_another_process_is_shown(tmp_path: Path) -> None:
    pytest.importorskip("grpc_tools")
    (tmp_path / "beacon.proto").write_text(BEACON)
    run("compile", str(tmp_path / "beacon.proto"), "--out", str(tmp_path))
    async with master_process() as (_, address):
        async with program(TALKER, str(tmp_path), master=address) as talker:
            assert await talker.line() == "ready"
            show = ["-m", "simple_ros.cli.main", "msg", "show", "lab/Beacon", "--master", address]
            async with python(*show) as shown:
                assert await shown.line() == "message lab.Beacon {"
                assert await shown.line() == "  geometry_msgs.Pose pose = 1"
                assert await shown.wait() == 0

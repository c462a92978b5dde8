"""The shell's Tab key: names from the Master, at once or not at all."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path

import pytest
from support.cli import register, run

from simple_ros.aio import NodeHandle
from simple_ros.cli.completion import complete_types, offered
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.names import topic_name
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master import Master

pytestmark = pytest.mark.usefixtures("patient_master")


async def completed(line: str, **environment: str) -> list[str]:
    """What bash is given for a line whose last word is being typed."""
    code, stdout, stderr = await run(
        _SIMPLE_ROS_COMPLETE="complete_bash",
        COMP_WORDS=line,
        COMP_CWORD=str(len(line.split(" ")) - 1),
        **environment,
    )
    assert (code, stderr) == (0, "")
    return stdout.split()


class TestNames:
    @pytest.mark.parametrize(
        ("typed", "names"),
        [
            ("", ["odom", "scan", "scan/raw"]),
            ("sc", ["scan", "scan/raw"]),
            ("/sc", ["/scan", "/scan/raw"]),
            ("x", []),
        ],
    )
    def test_those_that_go_on(self, typed: str, names: list[str]) -> None:
        known = ["scan", "odom", "scan/raw", "scan"]
        assert offered(known, typed, topic_name) == names

    @pytest.mark.parametrize(
        "name", ["$(reboot)", "a b", "a;b", "a`b`", "a\nb", "a'b", 'a"b', "a:b", "a*", ""]
    )
    def test_none_that_could_mean_something_to_a_shell(self, name: str) -> None:
        assert offered([name, "a"], "", topic_name) == ["a"]

    def test_types_in_the_spelling_that_was_begun(self) -> None:
        assert "geometry_msgs.Twist" in complete_types("geometry_msgs.T")
        assert "geometry_msgs/Twist" in complete_types("geometry_msgs/T")
        assert "geometry_msgs.Twist" in complete_types("")
        assert complete_types("no_msgs") == []


class TestTheShell:
    async def test_names_of_the_master(self, master: Master) -> None:
        at = f"--master {master.address}"
        async with NodeHandle("robot", master=master.address) as node:
            await node.advertise("cmd_vel", Twist)
            evil = ros.NodeInfo(node_name="$(reboot)", ip="127.0.0.1", port=node.port)
            await register(master.address, evil, topic="cm`id`")
            by_option, by_environment, second, nodes, several, types = await asyncio.gather(
                completed(f"simple-ros topic echo {at} cm"),
                completed("simple-ros topic info ", SIMPLE_ROS_MASTER=master.address),
                completed(f"simple-ros topic hz {at} cmd_vel /c"),
                completed(f"simple-ros node info {at} "),
                completed(f"simple-ros node kill {at} ro"),
                completed(f"simple-ros topic pub {at} cmd_vel geometry_msgs/Twi"),
            )
            assert by_option == by_environment == ["cmd_vel"]
            assert second == ["/cmd_vel"]
            assert nodes == several == ["robot"]
            assert types[0] == "geometry_msgs/Twist"
            zsh = await run(
                _SIMPLE_ROS_COMPLETE="complete_zsh",
                _TYPER_COMPLETE_ARGS=f"simple-ros topic echo {at} cm",
            )
            assert zsh == (0, "_arguments '*: :((\"cmd_vel\"))'\n", "")
            fish = await run(
                _SIMPLE_ROS_COMPLETE="complete_fish",
                _TYPER_COMPLETE_FISH_ACTION="get-args",
                _TYPER_COMPLETE_ARGS=f"simple-ros topic echo {at} cm",
            )
            assert fish == (0, "cmd_vel\n", "")

    async def test_types(self) -> None:
        assert await completed("simple-ros msg show std_msgs.Str") == ["std_msgs.String"]

    async def test_verbs(self) -> None:
        assert await completed("simple-ros node ") == ["list", "info", "ping", "kill"]

    async def test_silence_without_a_master(self) -> None:
        with socket.socket() as mute:  # takes connections and never answers
            mute.bind(("127.0.0.1", 0))
            mute.listen()
            address = f"127.0.0.1:{mute.getsockname()[1]}"
            assert await completed("simple-ros topic echo ", SIMPLE_ROS_MASTER=address) == []
        assert await completed("simple-ros topic echo ", SIMPLE_ROS_MASTER=address) == []
        assert await completed("simple-ros topic echo ", SIMPLE_ROS_MASTER="no:where") == []

    @pytest.mark.parametrize(
        ("shell", "script"),
        [
            ("bash", ".bash_completions/simple-ros.sh"),
            ("zsh", ".zfunc/_simple-ros"),
            ("fish", ".config/fish/completions/simple-ros.fish"),
        ],
    )
    async def test_it_installs(self, shell: str, script: str, tmp_path: Path) -> None:
        code, stdout, stderr = await run(
            "--install-completion",
            shell,
            HOME=str(tmp_path),
            _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="yes",  # of the shell that runs the tests
        )
        assert (code, stderr) == (0, "")
        assert "completion installed" in stdout
        assert f"_SIMPLE_ROS_COMPLETE=complete_{shell}" in (tmp_path / script).read_text()

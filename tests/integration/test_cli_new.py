"""``simple-ros new``: what it writes works as it is."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support.cli import run
from support.pages import Page
from support.processes import python
from typer.testing import CliRunner

from simple_ros.cli.graph import CannotWrite
from simple_ros.cli.new import app
from simple_ros.cli.new.writing import snake_case, write_all
from simple_ros.errors import ConfigError, UnknownMessageType
from simple_ros_master import Master

PAGE = Path(__file__).parents[2] / "docs" / "tutorial" / "newcomer.md"


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def new(*words: str) -> str:
    result = CliRunner().invoke(app, list(words), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def refused(*words: str) -> BaseException:
    result = CliRunner().invoke(app, list(words))
    assert isinstance(result.exception, Exception)
    return result.exception


async def test_talker_and_listener_talk(master: Master) -> None:
    assert new("talker") == "made talker.py\nnext: python talker.py\n"
    assert new("listener") == "made listener.py\nnext: python listener.py\n"
    where = {"SIMPLE_ROS_MASTER": master.address}
    async with python("listener.py", **where) as listener, python("talker.py", **where) as talker:
        for _ in range(3):
            assert (await listener.line()).startswith("hello ")
        for process in (talker, listener):
            process.signal(signal.SIGINT)
            assert await process.wait() == 0
            assert await process.errors() == ""


async def test_a_type_of_ones_own(master: Master) -> None:
    pytest.importorskip("grpc_tools")
    assert new("talker", "-m", "Reading").splitlines() == [
        "made reading.proto",
        "made reading_pb2.py",
        "made reading_pb2.pyi",
        "made reading_talker.py",
        "next: python reading_talker.py",
    ]
    said = new("listener", "-m", "Reading")
    assert said == "made reading_listener.py\nnext: python reading_listener.py\n"
    where = {"SIMPLE_ROS_MASTER": master.address}
    async with (
        python("reading_listener.py", **where) as listener,
        python("reading_talker.py", **where),
    ):
        assert await listener.line() == 'name: "sensor"'
        assert (await listener.line()).startswith("value: ")
        code, stdout, _ = await run("topic", "echo", "reading", "--once", **where)
        assert (code, stdout.splitlines()[0]) == (0, 'name: "sensor"')


def test_without_the_compiler_the_next_commands_say_what_to_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "grpc_tools", None)
    assert new("talker", "-m", "Reading").splitlines()[-3:] == [
        "next: pip install grpcio-tools",
        "      simple-ros msg compile reading.proto",
        "      python reading_talker.py",
    ]
    said = new("package", "lab_one").splitlines()
    assert said[-4:] == [
        "next: pip install grpcio-tools",
        "      simple-ros msg compile lab_one/lab_one/reading.proto -I lab_one -o lab_one",
        "      pip install -e lab_one",
        "      lab-one",
    ]


async def test_shipped_types_names_and_topics(master: Master) -> None:
    new("talker", "-m", "geometry_msgs/Twist", "--topic", "/cmd_vel")
    new("listener", "watcher", "-m", "Twist", "--topic", "cmd_vel")
    where = {"SIMPLE_ROS_MASTER": master.address}
    async with python("twist_talker.py", **where), python("watcher.py", **where) as watcher:
        await watcher.line()  # both are there
        code, stdout, _ = await run("topic", "echo", "cmd_vel", "--once", **where)
        assert (code, stdout.splitlines()[0]) == (0, "linear: {}")


async def test_service(master: Master) -> None:
    assert new("service", "horn").splitlines() == [
        "made horn.py",
        "next: python horn.py",
        "      simple-ros service call horn 'data: true'",
    ]
    where = {"SIMPLE_ROS_MASTER": master.address}
    text = "import runpy, threading; runpy.run_path('horn.py')"
    async with python("-c", text, **where) as horn:
        called = await run("service", "call", "horn", "data: true", **where)
        while called[0] == 1 and "no service 'horn'" in called[2]:
            called = await run("service", "call", "horn", "data: true", **where)
        assert called == (0, 'success: true\nmessage: "switched on"\n', "")
        horn.signal(signal.SIGINT)
        assert await horn.wait() == 0


def test_message(here: Path) -> None:
    said = new("msg", "LaserReading", "--package", "lab")
    assert said == "made laser_reading.proto\nnext: simple-ros msg compile laser_reading.proto\n"
    text = (here / "laser_reading.proto").read_text()
    assert "package lab;" in text
    assert "message LaserReading {" in text


async def test_launch(master: Master) -> None:
    new("talker")
    assert new("launch").splitlines() == [
        "made robot.launch.yaml",
        "made listener.py",
        "next: simple-ros launch robot.launch.yaml",
    ]
    words = ("-m", "simple_ros.cli.main", "launch", "robot.launch.yaml", "--plain")
    async with python(*words, "topic:=hall", SIMPLE_ROS_MASTER=master.address) as launch:
        while "hello " not in await launch.line():
            pass
        listed = await run("topic", "list", SIMPLE_ROS_MASTER=master.address)
        assert "hall  " in listed[1]
        launch.signal(signal.SIGINT)
        assert await launch.wait() == 0


def test_package(here: Path) -> None:
    pytest.importorskip("grpc_tools")
    said = new("package", "lab_two").splitlines()
    assert said[-2:] == ["next: pip install -e lab_two", "      lab-two"]
    assert f"made {Path('lab_two', 'lab_two', 'reading_pb2.py')}" in said
    tested = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:asyncio"],
        cwd=here / "lab_two",
        env=os.environ | {"PYTHONPATH": str(here / "lab_two")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (tested.returncode, tested.stderr) == (0, ""), tested.stdout
    shown = subprocess.run(
        [sys.executable, "-m", "simple_ros.cli.main", "launch", "--show", "lab_two.launch.yaml"],
        cwd=here / "lab_two" / "lab_two",
        capture_output=True,
        text=True,
        check=True,
    )
    assert "-m lab_two.node" in shown.stdout


async def test_the_node_of_a_package_runs(master: Master, here: Path) -> None:
    pytest.importorskip("grpc_tools")
    new("package", "lab_three")
    where = {"SIMPLE_ROS_MASTER": master.address}
    async with python("-m", "lab_three.node", PYTHONPATH=str(here / "lab_three"), **where) as node:
        code = 1
        while code:
            code, stdout, _ = await run("topic", "echo", "readings", "--once", **where)
        assert stdout.splitlines()[0] == 'name: "sensor"'
        node.signal(signal.SIGINT)
        assert await node.wait() == 0


def test_nothing_is_overwritten(here: Path) -> None:
    mine = here / "talker.py"
    mine.write_text("mine")
    error = refused("talker")
    assert isinstance(error, FileExistsError)
    assert str(error) == "talker.py is there already and stays as it is; give another name"
    assert mine.read_text() == "mine"
    (here / "lab").mkdir()
    assert isinstance(refused("package", "lab"), FileExistsError)
    assert list((here / "lab").iterdir()) == []


def test_what_cannot_be_written_is_told_and_leaves_nothing(here: Path) -> None:
    (here / "taken").write_text("a file, no folder")
    with pytest.raises(CannotWrite, match=r"cannot write 'taken/b\.py': "):
        write_all({Path("a.py"): "a", Path("taken/b.py"): "b"})
    assert [path.name for path in here.iterdir()] == ["taken"]


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        (("talker", "my-node"), ConfigError),
        (("talker", "string"), ConfigError),
        (("package", "pytest"), ConfigError),
        (("package", "simple_ros"), ConfigError),
        (("msg", "reading"), ConfigError),
        (("talker", "-m", "lab.Reading"), UnknownMessageType),
        (("talker", "-m", "Pose"), UnknownMessageType),
    ],
)
def test_bad_names_are_refused_and_leave_nothing(
    words: tuple[str, ...], kind: type[Exception], here: Path
) -> None:
    assert isinstance(refused(*words), kind)
    assert list(here.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "expected"),
    [("Reading", "reading"), ("LaserReading", "laser_reading"), ("IMUData", "imudata")],
)
def test_file_names(name: str, expected: str) -> None:
    assert snake_case(name) == expected


@pytest.mark.parametrize("words", [("talker",), ("listener",)])
def test_the_tutorial_shows_what_is_written(words: tuple[str, ...], here: Path) -> None:
    new(*words)
    shown = {block.file_name: block.text for block in Page.read(PAGE).blocks()}
    file = f"{words[0]}.py"
    assert shown[file] == f"# {file}\n{(here / file).read_text()}".rstrip()

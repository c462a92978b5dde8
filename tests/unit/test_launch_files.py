"""Launch files: what they come to, and what is said about mistakes in them."""

from __future__ import annotations

import textwrap
from pathlib import Path

import pytest

from simple_ros.launch import LaunchFileError, ReadyWhen, Respawn, arguments_of, describe
from simple_ros.launch.description import LaunchDescription, ProcessDescription
from simple_ros.launch.parameters import fits, parameter_words, parameters_for


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(path: Path, text: str) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_text(textwrap.dedent(text))


def described(here: Path, text: str, **given: str) -> LaunchDescription:
    write(here / "robot.yaml", text)
    return describe("robot.yaml", given)


def only(description: LaunchDescription) -> ProcessDescription:
    (process,) = description.processes
    return process


def complaint(here: Path, text: str, **given: str) -> str:
    with pytest.raises(LaunchFileError) as caught:
        described(here, text, **given)
    return str(caught.value)


def test_a_node_with_everything(here: Path) -> None:
    text = """\
        launch:
          - node: camera
            module: my_robot.camera
            args: [--fast, 3]
            namespace: front
            env: {LEVEL: 2, GONE: null}
            remap: {image: raw}
            parameters: {rate: 2.5, deep: {on: true, names: [a, b]}}
            cwd: data
            ready: "output:up and running"
            ready_timeout: 3
            respawn: {limit: 3, within: 20, delay: 1, max_delay: 4, when: always}
            required: true
            limits: {memory: 512MiB, cpu_seconds: 9, files: 64, nice: 5}
            log: both
    """
    node = only(described(here, text))
    assert node.name == "front/camera"
    assert node.command[1:] == ("-m", "my_robot.camera", "--fast", "3")
    assert node.words == (
        "__name:=camera",
        "__ns:=/front",
        "image:=raw",
        "_rate:=2.5",
        "_deep.on:=true",
        "_deep.names:=[a, b]",
    )
    assert node.environment == {"PYTHONUNBUFFERED": "1", "LEVEL": "2", "GONE": None}
    assert node.variables["SIMPLE_ROS_ARGS"] == " ".join(node.words[:-1]) + " '_deep.names:=[a, b]'"
    assert node.cwd == str(here / "data")
    assert str(node.ready) == "output:up and running"
    assert node.respawn == Respawn(3, 20.0, 1.0, 4.0, always=True)
    assert node.limits.memory_bytes == 512 * 2**20
    assert (node.limits.cpu_seconds, node.limits.files, node.limits.nice) == (9, 64, 5)
    assert (node.place.file, node.place.line) == ("robot.yaml", 2)


def test_arguments_keep_their_types(here: Path) -> None:
    text = """\
        args:
          sim: true
          rate: {type: float, default: 2}
          mode: {default: burst, choices: [burst, realtime]}
        launch:
          - node: a
            program: "$(arg mode)-$(arg rate)"
            if: $(arg sim)
            parameters: {rate: $(arg rate), text: "$(arg rate)!", is: "$(equals $(arg mode) burst)"}
          - node: b
            program: x
            unless: $(arg sim)
    """
    assert only(described(here, text)).words[1:] == ("_rate:=2.0", "_text:=2.0!", "_is:=true")
    other = only(described(here, text, sim="false", mode="realtime", rate="1e3"))
    assert other.name == "b"
    assert [a.type for a in arguments_of("robot.yaml")] == ["bool", "float", "str"]
    assert "'mode' cannot be 'fast'; it is one of burst, realtime" in complaint(
        here, text, mode="fast"
    )
    assert complaint(here, text, simm="1").endswith("no argument 'simm'; did you mean 'sim'?")
    assert "'rate' must be of type float, not 'x'" in complaint(here, text, rate="x")


def test_an_argument_without_default_must_be_given(here: Path) -> None:
    text = "args: {port: {type: int, description: of the arm}}\nlaunch: []\n"
    expected = "robot.yaml: argument 'port' must be given (of the arm): port:=INT"
    assert complaint(here, text) == expected
    assert described(here, text, port="7").processes == ()


def test_substitutions(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PLACE", "lab")
    text = """\
        launch:
          - node: a
            program: x
            args: [$(env PLACE), $(env NOWHERE 1 2), $(dirname)/m, $(find-package simple_ros), $$(arg x)]
    """
    words = only(described(here, text)).command[1:]
    package = str(Path(describe.__code__.co_filename).parents[1])
    assert words == ("lab", "1 2", f"{here}/m", package, "$(arg x)")


def test_groups_namespaces_and_inherited_values(here: Path) -> None:
    text = """\
        env: {A: 1}
        launch:
          - namespace: robot1
            env: {B: 2}
            remap: {x: y}
            parameters: {/**: {rate: 1, keep: 2}}
            group:
              - node: a
                program: p
                parameters: {rate: 3}
                env: {A: 5}
              - node: /b
                program: p
              - namespace: arm
                group: [{node: c, program: p, after: [a, /b]}]
    """
    a, b, c = described(here, text).processes
    assert (a.name, b.name, c.name) == ("robot1/a", "b", "robot1/arm/c")
    assert a.environment == {"A": "5", "B": "2"}
    assert a.words == ("__name:=a", "__ns:=/robot1", "x:=y", "_rate:=3", "_keep:=2")
    assert c.after == ("robot1/a", "b")


def test_a_master_file_with_components_and_parameter_only_files(here: Path) -> None:
    write(here / "modes" / "burst.yaml", "args: {i: 1.0}\nparameters: {/**: {burst: $(arg i)}}\n")
    write(
        here / "parts" / "camera.yaml",
        """\
        args: {name: camera}
        parameters: [../params.yaml]
        launch: [{node: $(arg name), script: camera.py}]
        """,
    )
    write(here / "parts" / "camera.py", "")
    write(
        here / "params.yaml",
        "/**: {ros__parameters: {rate: 1, all: 1}}\nrobot1/left: {rate: 7}\n",
    )
    text = """\
        launch:
          - include: modes/burst.yaml
            args: {i: 0.5}
          - include: parts/camera.yaml
            namespace: robot1
            args: {name: left}
          - node: other
            program: p
    """
    left, other = described(here, text).processes
    assert left.command[-1] == str(here / "parts" / "camera.py")
    assert left.words[2:] == ("_burst:=0.5", "_rate:=7", "_all:=1")
    assert other.words == ("__name:=other", "_burst:=0.5")
    assert "robot.yaml:2: launch[0].args.j: there is no argument 'j'" in complaint(
        here, "launch:\n- {include: modes/burst.yaml, args: {j: 1}}\n"
    )
    write(here / "self.yaml", "launch: [{include: self.yaml}]\n")
    assert "includes itself" in complaint(here, "launch: [{include: self.yaml}]\n")


def test_after_something_that_is_not_wanted(here: Path) -> None:
    write(here / "part.yaml", "launch: [{node: leg, program: p}]")
    text = """\
        launch:
          - {node: sim, program: p, if: false}
          - {unless: true, group: [{node: arm, program: p}]}
          - {include: gone.yaml, if: false}
          - {include: part.yaml, if: false, namespace: far}
          - {node: a, program: p, after: [sim, arm, far/leg]}
    """
    assert only(described(here, text)).after == ()


def test_several_nodes_in_one_process(here: Path) -> None:
    text = "launch: [{node: eyes, components: ['a.b:camera', 'low=c:lidar']}]"
    node = only(described(here, text))
    assert node.command[1:] == ("-m", "simple_ros.components", "a.b:camera", "low=c:lidar")
    assert node.words == ()
    assert node.ready.when is ReadyWhen.STARTED


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("launch: [", "robot.yaml:1: is not YAML: "),
        ("- a\n", "robot.yaml:1: a launch file must be a mapping, not a list"),
        ("lunch: []", "robot.yaml:1: lunch: there is no key 'lunch' here; did you mean 'launch'?"),
        ("a: 1\na: 2", "robot.yaml:2: a: this key stands in line 1 already"),
        ("launch: [{node: a}]", "'a' must have one of module, script, program, components"),
        (
            "launch:\n- node: a\n  program: p\n  reqired: 1",
            "robot.yaml:4: launch[0].reqired: there",
        ),
        ("launch:\n- node: a\n  program: p\n  required: 1", "'required' must be of type bool"),
        ("launch:\n- node: a-b\n  program: p", "launch[0].node: 'a-b' is no name: it must not"),
        (
            "launch:\n- node: a\n  script: gone.py",
            "robot.yaml:3: launch[0].script: there is no file",
        ),
        (
            "launch:\n- node: a\n  program: p\n  limits: {memory: lots}",
            "limits.memory: must be a size",
        ),
        (
            "launch:\n- node: a\n  program: p\n  ready: soon",
            "'soon'; it is one of notify, registered",
        ),
        (
            "launch:\n- node: a\n  program: p\n  respawn: {limit: -1}",
            "respawn.limit: must be at least 0",
        ),
        (
            "launch:\n- node: a\n  program: $(arg x)",
            "launch[0].program: this file has no argument 'x'",
        ),
        ("launch:\n- node: a\n  program: $(agr x)", "no substitution $(agr); did you mean 'arg'?"),
        ("launch:\n- node: a\n  program: $(arg x", "a ')' is missing"),
        ("launch:\n- node: a\n  program: $(env NO_SUCH)", "variable NO_SUCH is not set"),
        ("launch:\n- node: a\n  program: p\n  parameters: gone.yaml", "cannot read "),
        ("launch:\n- node: a\n  program: p\n  after: b", "launch[0].after: there is no node 'b'"),
        ("launch:\n- {node: a, program: p}\n- {node: a, program: p}", "in robot.yaml:2: launch[0]"),
        ("launch:\n- {node: master, program: p}", "the name 'master' is that of the Master"),
        ("launch:\n- {node: a, components: [b]}", "'b' is not MODULE:FUNCTION"),
        ("launch:\n- {program: p}", "must have exactly one of node, group, include, parameters"),
        (
            "launch:\n- {node: a, program: p, after: b}\n- {node: b, program: p, after: a}",
            " waits for ",
        ),
    ],
)
def test_mistakes_name_file_line_and_key(here: Path, text: str, expected: str) -> None:
    said = complaint(here, text)
    assert said.startswith("robot.yaml:")
    assert expected in said


PYTHON = """\
from simple_ros.launch.entries import argument, group, include, node, parameters

ARGS = {"robots": argument(type="int", default=2)}


def launch(args):
    return [
        parameters({"/**": {"rate": 1.0}}),
        *(group([node("a", program="p", if_=n >= 0)], namespace=f"r{n}") for n in range(args["robots"])),
    ]
"""


def test_a_file_in_python(here: Path) -> None:
    write(here / "robot.py", PYTHON)
    names = [process.name for process in describe("robot.py", {"robots": "3"}).processes]
    assert names == ["r0/a", "r1/a", "r2/a"]
    assert describe("robot.py").processes[0].words[-1] == "_rate:=1.0"
    for old, new, expected in (
        ('program="p"', 'progam="p"', "robot.py:9: progam: there is no key 'progam'"),
        ("range(args", "range(1 // 0 + args", "robot.py:9: ZeroDivisionError"),
        ("def launch", "def lunch", "robot.py: must define launch(args)"),
        ("return [", "return [(", "robot.py:"),
    ):
        write(here / "robot.py", PYTHON.replace(old, new))
        with pytest.raises(LaunchFileError, match=r"robot\.py") as caught:
            describe("robot.py")
        assert expected in str(caught.value)


def test_parameter_names_and_words() -> None:
    assert fits("/**", "a/b")
    assert fits("b", "a/b")
    assert fits("/a/*", "a/b")
    assert not fits("/b", "a/b")
    assert not fits("/*", "a/b")
    chosen = parameters_for("a/b", {"b": {"x": 1}, "/**": {"x": 2, "y": {"z": 3}}})
    assert chosen == {"x": 1, "y": {"z": 3}}
    words = parameter_words({"n": None, "e": {}, "t": "1", "long": "w " * 80, "two": "a\nb"})
    assert words[:3] == ["_n:=null", "_e:={}", "_t:='1'"]
    assert not any("\n" in word for word in words)

"""Verdicts on Python and the packages."""

from dataclasses import replace

import pytest

from simple_ros.doctor.findings import Level
from simple_ros.doctor.judge_installation import (
    Installation,
    Package,
    Shadow,
    fits,
    judge_installation,
    parse_requirement,
    release,
)

PROTOBUF = Package("protobuf", ">=6.31.1,<8", "6.33.0")
GOOD = Installation(
    python=(3, 12, 1),
    implementation="cpython",
    version="0.1.0",
    loaded_from="/site/simple_ros",
    copies=("/site/simple_ros",),
    distributions=(("0.1.0", "/site"),),
    packages=(PROTOBUF, Package("uvloop", ">=0.21", "", extra="uvloop")),
    generated_by="6.31.1",
    protobuf_backend="upb",
    shadows=(),
)


def told(level: Level, **changes: object) -> list[str]:
    """Findings of a level in an installation that is good but for ``changes``."""
    findings = judge_installation(replace(GOOD, **changes))
    assert all(finding.fix for finding in findings if finding.level is not Level.OK)
    return [f"{found.check}: {found.text}" for found in findings if found.level is level]


def test_a_good_one():
    assert told(Level.WARNING) == told(Level.ERROR) == []
    assert "uvloop: not installed (optional: pip install 'simple-ros[uvloop]')" in told(Level.OK)


def test_python():
    assert told(Level.ERROR, python=(3, 10, 9)) == ["python: cpython 3.10.9 is too old"]
    assert "newer than" in told(Level.OK, python=(3, 14, 0))[0]


@pytest.mark.parametrize(
    ("package", "text"),
    [
        (replace(PROTOBUF, installed=""), "protobuf: not installed"),
        (replace(PROTOBUF, installed="5.29.1"), "protobuf: 5.29.1 is installed, simple-ros needs"),
        (replace(PROTOBUF, problem="ImportError: x"), "cannot be imported: ImportError: x"),
    ],
)
def test_a_package_that_does_not_do(package, text):
    assert text in told(Level.ERROR, packages=(package,), generated_by="4.1")[0]


@pytest.mark.parametrize(
    ("generated", "runtime", "level"),
    [
        ("6.31.1", "6.31.1", Level.OK),
        ("6.31.1", "7.0.0", Level.OK),
        ("6.31.1", "6.31.0", Level.ERROR),
        ("6.31.1", "8.0.0", Level.ERROR),
        ("", "6.31.1", Level.WARNING),
    ],
)
def test_generated_code_and_its_runtime(generated, runtime, level):
    found = replace(GOOD, generated_by=generated, packages=(Package("protobuf", "", runtime),))
    (finding,) = (one for one in judge_installation(found) if one.check == "messages")
    assert finding.level is level


def test_protobuf_in_pure_python():
    assert "many times slower" in told(Level.WARNING, protobuf_backend="python")[0]


def test_two_installations():
    two = (("0.1.0", "/site"), ("0.0.9", "/other"))
    assert told(Level.ERROR, distributions=two) == [
        "simple-ros: installed 2 times: 0.1.0 in /site, 0.0.9 in /other"
    ]
    copies = ("/site/simple_ros", "/home/simple_ros")
    (text,) = told(Level.WARNING, copies=copies)
    assert text.endswith("is on Python's path: /home/simple_ros")


@pytest.mark.parametrize(
    ("shadow", "level"),
    [
        (Shadow("simple_ros", "/here/simple_ros", "this folder"), Level.ERROR),
        (Shadow("google", "/here/google", "PYTHONPATH"), Level.ERROR),
        (Shadow("proto", "/here/proto", "this folder"), Level.WARNING),
        (Shadow("random", "/here/random.py", "this folder", is_standard=True), Level.WARNING),
        (Shadow("simple_ros", "/here/simple_ros", "this folder", is_complete=False), Level.OK),
    ],
)
def test_shadows(shadow, level):
    findings = judge_installation(replace(GOOD, shadows=(shadow,)))
    (finding,) = (one for one in findings if one.check == "shadowing")
    assert finding.level is level
    assert shadow.path in finding.text


def test_the_checkout_that_runs_hides_nothing():
    own = Shadow("simple_ros", GOOD.loaded_from, "this folder")
    assert told(Level.ERROR, shadows=(own,)) == []


def test_a_ros_installation_on_the_path_is_harmless():
    assert any("ROS installation" in text for text in told(Level.OK, has_ros_messages=True))


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("protobuf<8,>=6.31.1", ("protobuf", "<8,>=6.31.1", "")),
        ("PyYAML >= 6.0.1", ("pyyaml", ">=6.0.1", "")),
        ('uvloop>=0.21; extra == "uvloop"', ("uvloop", ">=0.21", 'extra == "uvloop"')),
        ("simple_ros[msg]", ("simple-ros", "", "")),
        ("old (>=1.0)", ("old", ">=1.0", "")),
    ],
)
def test_requirements(text, parts):
    assert parse_requirement(text) == parts


@pytest.mark.parametrize(
    ("version", "conditions", "verdict"),
    [
        ("6.31.1", ">=6.31.1,<8", True),
        ("6.31", ">=6.31.1", False),
        ("8.0", "<8", False),
        ("8.0rc1", "<8", False),
        ("1.74.3", "==1.74.*", True),
        ("1.75.0", "==1.74.*", False),
        ("1.75.0", "!=1.74.*", True),
        ("2.0", "==2.0.0", True),
        ("2.0", "!=2", False),
        ("1.4.9", "~=1.4.2", True),
        ("1.5.0", "~=1.4.2", False),
        ("3", ">3,<=4", False),
        ("4.0", ">3,<=4", True),
        ("4.0", "", True),
    ],
)
def test_versions(version, conditions, verdict):
    assert fits(version, conditions) is verdict


def test_release_numbers():
    assert release("v1.2.3.post1+local") == (1, 2, 3)
    assert release("unknown") == ()

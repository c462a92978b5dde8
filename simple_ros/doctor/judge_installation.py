"""Is what is installed what should be, and is it what programs get when they import it?"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from simple_ros.doctor.findings import Finding, error, ok, warning

__all__ = [
    "Installation",
    "Package",
    "Shadow",
    "fits",
    "judge_installation",
    "parse_requirement",
    "release",
]

_OLDEST_PYTHON = (3, 11)
_NEWEST_TRIED_PYTHON = (3, 13)
_REQUIREMENT = re.compile(r"\s*([\w.-]+)\s*(?:\[[^]]*\])?\s*\(?([^;()]*)\)?\s*(?:;(.*))?$")
_CONDITION = re.compile(r"(>=|<=|==|!=|~=|<|>)\s*([\w.*+!-]+)")
_HARMFUL = {
    "simple_ros": "the library itself",
    "google": "protobuf",
    "grpc": "gRPC",
    "numpy": "NumPy",
    "websockets": "websockets",
    "typer": "the command line",
    "rich": "the command line",
    "yaml": "PyYAML",
    "psutil": "psutil",
    "serial": "pyserial",
}


@dataclass(frozen=True, slots=True)
class Package:
    """A distribution that is needed.

    Attributes:
        name: Its name at the package index.
        wanted: Conditions on its version as in a requirement, ``>=6.31.1,<8``.
        installed: Its version; empty if it is not installed.
        extra: The extra of simple-ros that brings it; empty if simple-ros needs it.
        problem: Why it cannot be imported; empty if it can.
    """

    name: str
    wanted: str
    installed: str
    extra: str = ""
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Shadow:
    """A module or package in a folder that Python looks into before the installed ones.

    Attributes:
        name: What it is imported as.
        path: Where it is.
        folder: The folder as the user knows it, such as ``this folder``.
        is_complete: A file, or a folder with ``__init__.py``: those hide what is installed, while a plain
            folder gives way to it.
        is_standard: Python's own library has a module of that name.
    """

    name: str
    path: str
    folder: str
    is_complete: bool = True
    is_standard: bool = False


@dataclass(frozen=True, slots=True)
class Installation:
    """What was found out about Python and the packages.

    Attributes:
        python: Version of Python.
        implementation: ``cpython`` and so on.
        version: Installed version of simple-ros; empty if it runs without being installed.
        loaded_from: Folder of the simple_ros that runs now.
        copies: Folders of all packages simple_ros on the path of modules.
        distributions: Version and place of all installed distributions simple-ros.
        packages: What it needs.
        generated_by: Version of protobuf that generated the message classes.
        protobuf_backend: ``upb``, ``cpp`` or ``python``; empty if unknown.
        shadows: What hides something.
        has_ros_messages: Whether ``PYTHONPATH`` brings the message packages of a ROS installation.
    """

    python: tuple[int, int, int]
    implementation: str
    version: str
    loaded_from: str
    copies: tuple[str, ...]
    distributions: tuple[tuple[str, str], ...]
    packages: tuple[Package, ...]
    generated_by: str
    protobuf_backend: str
    shadows: tuple[Shadow, ...]
    has_ros_messages: bool = False


def judge_installation(found: Installation) -> list[Finding]:
    """All findings about Python and the packages."""
    return [
        _python(found),
        *_copies(found),
        *(_package(package) for package in found.packages),
        _generated_code(found),
        *_shadows(found),
    ]


def _python(found: Installation) -> Finding:
    text = f"{found.implementation} {'.'.join(map(str, found.python))}"
    if found.python[:2] < _OLDEST_PYTHON:
        return error("python", f"{text} is too old", "install Python 3.11 or newer")
    if found.python[:2] > _NEWEST_TRIED_PYTHON:
        return ok("python", f"{text} (newer than what simple-ros is tested with)")
    return ok("python", text)


def _copies(found: Installation) -> Iterator[Finding]:
    version = found.version or "not installed as a distribution"
    yield ok("simple-ros", f"{version}, from {found.loaded_from}")
    others = [path for path in found.copies if path != found.loaded_from]
    if others:
        yield warning(
            "simple-ros",
            f"another copy of simple_ros is on Python's path: {', '.join(others)}",
            "remove one of them: 'pip uninstall simple-ros', or take the folder out of PYTHONPATH",
        )
    if len(found.distributions) > 1:
        listed = ", ".join(f"{version} in {place}" for version, place in found.distributions)
        yield error(
            "simple-ros",
            f"installed {len(found.distributions)} times: {listed}",
            "'pip uninstall simple-ros' until none is left, then install it once",
        )


def _package(package: Package) -> Finding:
    name, wanted = package.name, package.wanted
    if not package.installed:
        if package.extra:
            return ok(name, f"not installed (optional: pip install 'simple-ros[{package.extra}]')")
        return error(name, "not installed", f"pip install '{name}{wanted}'")
    if not fits(package.installed, wanted):
        return error(
            name,
            f"{package.installed} is installed, simple-ros needs {wanted}",
            f"pip install '{name}{wanted}'",
        )
    if package.problem:
        return error(
            name,
            f"{package.installed} is installed but cannot be imported: {package.problem}",
            f"pip install --force-reinstall '{name}{wanted}'",
        )
    return ok(name, f"{package.installed} ({wanted or 'any version'} is needed)")


def _generated_code(found: Installation) -> Finding:
    check = "messages"
    runtime = next((p.installed for p in found.packages if p.name == "protobuf"), "")
    if not (runtime and found.generated_by):
        return warning(
            check,
            "which protobuf generated the message classes cannot be told",
            "pip install --force-reinstall simple-ros",
        )
    text = f"generated by protobuf {found.generated_by}, running on {runtime}"
    generated, running = release(found.generated_by), release(runtime)
    # A runtime takes code of its own major version and of the one before, never newer code.
    if running < generated or running[0] > generated[0] + 1:
        return error(
            check, f"{text}: these do not fit", f"pip install 'protobuf>={found.generated_by}'"
        )
    if found.protobuf_backend == "python":
        return warning(
            check,
            f"{text}, in pure Python: many times slower",
            "unset PROTOCOL_BUFFERS_PYTHON_IMPLEMENTATION, or reinstall protobuf from a wheel",
        )
    return ok(check, text)


def _shadows(found: Installation) -> Iterator[Finding]:
    check = "shadowing"
    judged = 0
    for shadow in found.shadows:
        finding = _shadow(check, shadow, found.loaded_from)
        if finding is not None:
            judged += 1
            yield finding
    if not judged:
        yield ok(check, "nothing in this folder or PYTHONPATH hides an installed package")
    if found.has_ros_messages:
        yield ok(
            check,
            "PYTHONPATH has the packages of a ROS installation; simple_ros.msg is apart from them",
        )


def _shadow(check: str, shadow: Shadow, loaded_from: str) -> Finding | None:
    if shadow.path == loaded_from:
        return None
    what = f"{shadow.path} in {shadow.folder}"
    if not shadow.is_complete:
        return ok(
            check, f"{what} has no __init__.py: the installed {shadow.name!r} is found all the same"
        )
    fix = f"rename it, or start programs from another folder ({shadow.folder} comes first)"
    if shadow.name in _HARMFUL:
        return error(
            check, f"{what} hides {_HARMFUL[shadow.name]} (import {shadow.name}) from programs", fix
        )
    if shadow.is_standard:
        return warning(check, f"{what} hides Python's own module {shadow.name!r}", fix)
    return warning(check, f"{what} hides any installed package {shadow.name!r}", fix)


# -- versions --------------------------------------------------------------------------------------


def parse_requirement(text: str) -> tuple[str, str, str]:
    """Name, conditions on the version and marker of a requirement, in the normal form of names."""
    match = _REQUIREMENT.match(text)
    if match is None:
        return text.strip().lower(), "", ""
    name, conditions, marker = match.groups(default="")
    return re.sub(r"[-_.]+", "-", name).lower(), conditions.replace(" ", ""), marker.strip()


def release(version: str) -> tuple[int, ...]:
    """The numbers of a version, without what marks it as a pre-release, post-release or local."""
    match = re.match(r"v?(?:\d+!)?(\d+(?:\.\d+)*)", version.strip())
    return tuple(map(int, match[1].split("."))) if match else ()


def fits(version: str, conditions: str) -> bool:
    """Whether a version meets conditions such as ``>=6.31.1,<8``.

    Only the numbers are compared: a pre-release counts as the release.
    """
    have = release(version)
    return all(
        _fits_one(have, operator, limit) for operator, limit in _CONDITION.findall(conditions)
    )


def _fits_one(have: tuple[int, ...], operator: str, limit: str) -> bool:
    if limit.endswith(".*"):
        prefix = release(limit)
        return (have[: len(prefix)] == prefix) is (operator == "==")
    want = release(limit)
    length = max(len(have), len(want))
    left, right = (numbers + (0,) * (length - len(numbers)) for numbers in (have, want))
    match operator:
        case ">=":
            return left >= right
        case "<=":
            return left <= right
        case "<":
            return left < right
        case ">":
            return left > right
        case "!=":
            return left != right
        case "~=":
            return left >= right and have[: len(want) - 1] == want[:-1]
        case _:
            return left == right

"""Python, the packages, and what could hide them."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Iterator
from importlib import import_module, metadata, util
from pathlib import Path

import simple_ros
from simple_ros.doctor.judge_installation import (
    Installation,
    Package,
    Shadow,
    parse_requirement,
)

__all__ = ["DISTRIBUTION", "installed_version", "look_at_installation"]

DISTRIBUTION = "simple-ros"
# Where a module is named otherwise than its distribution; imported to see whether they can be.
_IMPORTED = {
    "protobuf": "google.protobuf.message",
    "grpcio": "grpc",
    "numpy": "numpy",
    "websockets": "websockets",
}
_NOT_FOR_USERS = ("all", "dev", "docs", "test")
_WATCHED = (
    "simple_ros",
    "google",
    "grpc",
    "numpy",
    "websockets",
    "typer",
    "rich",
    "yaml",
    "psutil",
    "serial",
    "proto",
    "master",
)
_ROS_PACKAGES = ("geometry_msgs", "std_msgs", "rclpy", "rospy")
_GENERATED_BY = re.compile(r"^# Protobuf Python Version: (\S+)", re.MULTILINE)


def look_at_installation() -> Installation:
    """All of it; reads files and imports the packages that simple-ros needs."""
    requirements = _requirements()
    own = Path(simple_ros.__file__).resolve().parent
    pythonpath = [entry for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    return Installation(
        python=sys.version_info[:3],
        implementation=sys.implementation.name,
        version=installed_version(),
        loaded_from=str(own),
        copies=tuple(_copies(sys.path)),
        distributions=tuple(
            (found.version, str(found.locate_file("")))
            for found in metadata.distributions(name=DISTRIBUTION)
        ),
        packages=tuple(_package(*requirement) for requirement in requirements),
        generated_by=_generated_by(own / "rpc" / "ros_rpc_pb2.py"),
        protobuf_backend=_protobuf_backend(),
        shadows=(
            *_shadows(Path.cwd(), "this folder", standard=True),
            *(shadow for entry in pythonpath for shadow in _shadows(Path(entry), "PYTHONPATH")),
        ),
        has_ros_messages=any(
            (Path(entry) / name).is_dir() for entry in pythonpath for name in _ROS_PACKAGES
        ),
    )


def _requirements() -> list[tuple[str, str, str]]:
    """Name, conditions and extra of all that simple-ros needs or may use."""
    try:
        texts = metadata.requires(DISTRIBUTION) or []
    except metadata.PackageNotFoundError:
        return [(name, "", "") for name in _IMPORTED]
    found = []
    for text in texts:
        name, conditions, marker = parse_requirement(text)
        extra = re.search(r"extra\s*==\s*['\"]([\w-]+)['\"]", marker)
        if extra is None:
            found.append((name, conditions, ""))
        elif extra[1] not in _NOT_FOR_USERS:
            found.append((name, conditions, extra[1]))
    return found


def installed_version(distribution: str = DISTRIBUTION) -> str:
    """The version of an installed distribution; empty if it is not installed."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return ""


def _package(name: str, wanted: str, extra: str) -> Package:
    installed, problem = installed_version(name), ""
    if installed and name in _IMPORTED:
        try:
            import_module(_IMPORTED[name])
        except Exception as error:
            # A broken binary wheel raises anything.
            problem = f"{type(error).__name__}: {error}"
    return Package(name, wanted, installed, extra, problem)


def _copies(path: Iterable[str]) -> Iterator[str]:
    """Folders of complete packages simple_ros, each once."""
    seen = set()
    for entry in path:
        folder = (Path(entry) / "simple_ros").resolve()
        if folder not in seen and (folder / "__init__.py").is_file():
            seen.add(folder)
            yield str(folder)


def _generated_by(path: Path) -> str:
    try:
        found = _GENERATED_BY.search(path.read_text(encoding="utf-8"))
    except OSError:
        return ""
    return found[1] if found else ""


def _protobuf_backend() -> str:
    name = "google.protobuf.internal.api_implementation"
    try:
        return str(import_module(name).Type()) if util.find_spec(name) else ""
    except Exception:
        # Told by the finding about protobuf itself.
        return ""


def _shadows(folder: Path, called: str, *, standard: bool = False) -> Iterator[Shadow]:
    for name in _WATCHED:
        for path in (folder / name, folder / f"{name}.py"):
            if path.is_file() if path.suffix else path.is_dir():
                is_complete = path.suffix == ".py" or (path / "__init__.py").is_file()
                yield Shadow(name, str(path.resolve()), called, is_complete)
    if standard and folder.is_dir():
        for path in sorted(folder.glob("*.py")):
            if path.stem in sys.stdlib_module_names:
                yield Shadow(path.stem, str(path), called, is_standard=True)

"""Installs the rivals, each into an environment of its own: ``python benchmarks/peers_install.py [NAME ...]``.

From the Python package index that pip is configured for. rospy comes from Debian (``apt-get install python3-rospy
python3-rosmaster python3-geometry-msgs python3-sensor-msgs python3-std-srvs``) and the server of NATS, too
(``apt-get install nats-server``); this script makes rospy usable by the Python that measures, so that all peers
run on the same interpreter. What cannot be installed is told, and left out of the measurements with that
reason. No test needs any of it.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

VENVS = Path(os.environ.get("SIMPLE_ROS_BENCH_VENVS", Path(__file__).parent / ".venvs"))
RESULT = "result.json"
_ROS2 = ("geometry-msgs", "sensor-msgs", "std-srvs", "rmw-fastrtps-cpp")

PACKAGES: dict[str, tuple[str, ...]] = {
    "zmq": ("pyzmq",),
    "zenoh": ("eclipse-zenoh",),
    "cyclonedds": ("cyclonedds",),
    "iceoryx2": ("iceoryx2",),
    "lcm": ("lcm",),
    "nats": ("nats-py",),
    "dora": ("dora-rs", "dora-rs-cli", "pyarrow"),
    "rclpy_kilted": ("ros-kilted-rclpy", *(f"ros-kilted-{name}" for name in _ROS2)),
    "rclpy_jazzy": ("ros-jazzy-rclpy", *(f"ros-jazzy-{name}" for name in _ROS2)),
    "rospy": (),
}
PROVES = {
    "zmq": "zmq",
    "zenoh": "zenoh",
    "cyclonedds": "cyclonedds.pub",
    "iceoryx2": "iceoryx2",
    "lcm": "lcm",
    "nats": "nats",
    "dora": "dora",
    "rclpy_kilted": "rclpy, geometry_msgs.msg, sensor_msgs.msg",
    "rclpy_jazzy": "rclpy, geometry_msgs.msg, sensor_msgs.msg",
    "rospy": "rospy, geometry_msgs.msg, sensor_msgs.msg",
}
"""What must be importable for a rival to be measured."""
_DEBIAN_PACKAGES = Path("/usr/lib/python3/dist-packages")


def python_of(name: str) -> Path:
    return VENVS / name / "bin" / "python"


def install(name: str) -> str:
    """Make the environment anew; why it failed, or an empty text."""
    directory = VENVS / name
    venv.create(directory, clear=True, with_pip=True)
    # The same protobuf for everybody: rivals carry what we carry.
    protobuf = f"protobuf=={importlib.metadata.version('protobuf')}"
    pip = [str(python_of(name)), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    if name == "rospy":
        reason = _lend_debian(directory)
        if reason:
            return reason
    found = subprocess.run(
        [*pip, protobuf, *PACKAGES[name]], capture_output=True, text=True, check=False
    )
    if found.returncode:
        errors = [line for line in found.stderr.splitlines() if "error" in line.lower()]
        return (errors or ["pip failed"])[0].strip()
    proof = subprocess.run(
        [str(python_of(name)), "-c", f"import {PROVES[name]}"],
        capture_output=True,
        text=True,
        check=False,
    )
    return "" if proof.returncode == 0 else proof.stderr.strip().splitlines()[-1]


def _lend_debian(directory: Path) -> str:
    """Let the environment see Debian's packages, if they are for this version of Python."""
    if not (_DEBIAN_PACKAGES / "rospy").is_dir():
        return "apt-get install python3-rospy python3-geometry-msgs python3-sensor-msgs"
    own = f"{sys.version_info.major}.{sys.version_info.minor}"
    theirs = subprocess.run(
        ["/usr/bin/python3", "-c", "import sys; print('%d.%d' % sys.version_info[:2])"],
        capture_output=True,
        text=True,
        check=False,
    ).stdout.strip()
    if own != theirs:
        return f"Debian's rospy is for Python {theirs}, this is {own}"
    packages = directory / "lib" / f"python{own}" / "site-packages"
    (packages / "zz_debian.pth").write_text(f"{_DEBIAN_PACKAGES}\n")
    return ""


def versions(name: str) -> dict[str, str]:
    """What is installed of the packages that were asked for."""
    code = (
        "import json, sys, importlib.metadata as m\n"
        "print(json.dumps({name: m.version(name) for name in sys.argv[1:]}))"
    )
    wanted = ("rospy",) if name == "rospy" else PACKAGES[name]
    found = subprocess.run(
        [str(python_of(name)), "-c", code, *wanted], capture_output=True, text=True, check=False
    )
    return dict(json.loads(found.stdout)) if found.returncode == 0 else {}


def result_of(name: str) -> dict[str, object]:
    """What `main` noted about a rival."""
    file = VENVS / name / RESULT
    if not file.exists():
        return {"reason": "not installed: python benchmarks/peers_install.py", "versions": {}}
    return dict(json.loads(file.read_text()))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(PACKAGES)}")
    parser.add_argument("--remove", action="store_true", help="remove all environments instead")
    args = parser.parse_args()
    if args.remove:
        shutil.rmtree(VENVS, ignore_errors=True)
        return
    unknown = set(args.names) - set(PACKAGES)
    if unknown:
        parser.error(f"unknown: {', '.join(unknown)}; there are {', '.join(PACKAGES)}")
    for name in args.names or PACKAGES:
        reason = install(name)
        found = versions(name) if not reason else {}
        note = {"reason": reason, "versions": found, "python": sys.version.split()[0]}
        (VENVS / name / RESULT).write_text(json.dumps(note))
        told = reason or ", ".join(f"{package} {version}" for package, version in found.items())
        print(f"{name:<14}{told}", flush=True)


if __name__ == "__main__":
    main()

"""The public names are there, documented, and cheap to import."""

from __future__ import annotations

import subprocess
import sys

import simple_ros
from simple_ros import aio


def test_every_public_name_exists_and_is_documented() -> None:
    for module in (simple_ros, aio):
        assert sorted(set(module.__all__)) == sorted(module.__all__)
        for name in module.__all__:
            value = getattr(module, name)
            if isinstance(value, type):
                assert value.__doc__, name
    assert simple_ros.__version__


def test_values_and_errors_cost_no_network_stack() -> None:
    code = "import sys, simple_ros; print('grpc' in sys.modules, 'numpy' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == "False False\n"

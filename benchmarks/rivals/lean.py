"""Import this first in a rival's program: it keeps simple_ros itself from being loaded.

Rivals take the generated messages and the counting from the package, nothing else; their time from start to
first message must not contain ours.
"""

import sys
import types
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2] / "simple_ros"


def _hollow(name: str, path: Path) -> None:
    module = types.ModuleType(name)
    module.__path__ = [str(path)]
    sys.modules[name] = module


for part in ("", ".msg", ".benchmark"):
    _hollow(f"simple_ros{part}", SOURCE / part[1:])

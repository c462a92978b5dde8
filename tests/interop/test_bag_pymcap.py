"""Another author's program judges our files."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.bags import make_bag

from simple_ros.bag import BagWriter
from simple_ros.bag.chunks import Compression
from simple_ros.bag.recovery import recover

PROGRAM = shutil.which("pymcap-cli", path=str(Path(sys.executable).parent))
MESSAGES = [("numbers" if n % 3 else "others", n / 100, str(n)) for n in range(300)]

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="pymcap-cli is not installed")


def judged(path: Path) -> str:
    """What the doctor says; he has to find nothing wrong."""
    assert PROGRAM is not None
    done = subprocess.run(
        [PROGRAM, "doctor", str(path)], capture_output=True, text=True, timeout=30, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    text = " ".join(done.stdout.split())
    assert "passed MCAP doctor checks" in text
    assert "error" not in text.lower()
    assert "warning" not in text.lower()
    return text


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_a_recording(tmp_path: Path, compression: Compression) -> None:
    path = make_bag(tmp_path / "a.mcap", MESSAGES, compression=compression, flush_every=50)
    with BagWriter(tmp_path / "b.mcap", compression) as writer:
        writer.note("custom", {"run": "7"})
        writer.attach("map.yaml", "application/yaml", b"resolution: 0.05\n", 5)
    assert "6 chunks, 300 messages" in judged(path)
    judged(tmp_path / "b.mcap")


def test_what_was_recovered(tmp_path: Path) -> None:
    path = make_bag(tmp_path / "a.mcap", MESSAGES, flush_every=50)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    found = recover(cut, tmp_path / "out.mcap")
    assert 0 < found.messages < 300
    assert f"{found.messages} messages" in judged(found.path)

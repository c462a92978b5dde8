"""What can be wrong with a bag file.

::

    BagError                     SimpleRosError   a bag cannot be read or written
    ├── NotABag                  ValueError       the file is no MCAP file, or of an unknown version
    ├── BagDamaged               ValueError       the file breaks off, or a part of it is not as written
    ├── BagExists                FileExistsError  nothing is written over an existing file
    ├── BagUnavailable           OSError          a file cannot be opened or made
    ├── DiskFull                 OSError          no more could be written; what was written is kept
    └── NothingToPlay            LookupError      no topic of a bag can be played
"""

from __future__ import annotations

from pathlib import Path

from simple_ros.errors import SimpleRosError

__all__ = [
    "BagDamaged",
    "BagError",
    "BagExists",
    "BagUnavailable",
    "DiskFull",
    "NotABag",
    "NothingToPlay",
]


class BagError(SimpleRosError):
    """A bag cannot be read or written."""


class NotABag(BagError, ValueError):
    """The file is no MCAP file.

    Attributes:
        path: The file.
        reason: What was found instead.
    """

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"{path} is no bag: {reason}")


class BagDamaged(BagError, ValueError):
    """The file breaks off, or a part of it is not as it was written.

    Attributes:
        path: The file.
        offset: Where, in bytes from its beginning.
        reason: What is wrong there.
    """

    def __init__(self, path: Path, offset: int, reason: str) -> None:
        self.path = path
        self.offset = offset
        self.reason = reason
        super().__init__(
            f"{path}, byte {offset}: {reason}; "
            f"'simple-ros bag recover {path} OUT.mcap' saves what is whole"
        )


class BagExists(BagError, FileExistsError):
    """Nothing is written over an existing file.

    Attributes:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        super().__init__(f"{path} exists; choose another name or remove it")


class BagUnavailable(BagError, OSError):
    """A file cannot be opened or made.

    Attributes:
        path: The file.
        reason: What the system said.
    """

    def __init__(self, path: Path, error: OSError) -> None:
        self.path = path
        self.reason = error.strerror or str(error)
        super().__init__(f"{path}: {self.reason}")


class DiskFull(BagError, OSError):
    """No more could be written; the file holds what was written before.

    Attributes:
        path: The file.
        reason: What the system said.
    """

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"{path}: cannot write on: {reason}")


class NothingToPlay(BagError, LookupError):
    """No topic of the bag can be played; the message says why."""

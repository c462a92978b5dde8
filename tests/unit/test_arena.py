"""Memory that processes share: who may write where, and when."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from simple_ros.errors import FrameError
from simple_ros.net import arena as arenas
from simple_ros.net.arena import Arena, ArenaReader, Window, is_available
from simple_ros.wire.slots import TABLE_BYTES, SlotRef

pytestmark = pytest.mark.skipif(not is_available(), reason="this system cannot share memory")

MIB = 1024 * 1024


@pytest.fixture
def arena() -> Iterator[Arena]:
    made = Arena(8 * MIB)
    yield made
    made.close()


def window_to(arena: Arena) -> Window:
    return Window.shared(arena.identity, os.dup(arena.fd))


def announced(reader: ArenaReader, *parts: bytes) -> SlotRef:
    frame = reader.announce(parts)
    assert frame is not None
    return SlotRef.parse(frame[-28:])


def test_a_view_shows_what_was_put_and_holds_the_slot_until_the_last_of_it_is_gone(
    arena: Arena,
) -> None:
    window = window_to(arena)
    reader = arena.join(os.getpid())
    ref = announced(reader, b"head", b"x" * 100_000)
    view = window.take(ref, reader.number)
    assert view.readonly
    assert bytes(view) == b"head" + b"x" * 100_000
    part = view[2:6]
    del view
    assert arena.busy_slots == 1
    other = announced(reader, b"y" * 100_000)
    assert other.slot != ref.slot
    assert bytes(part) == b"adxx"
    del part
    gc.collect()
    assert announced(reader, b"z" * 100_000).slot == ref.slot


def test_several_readers_share_a_slot_and_each_holds_it(arena: Arena) -> None:
    window = window_to(arena)
    first, second = arena.join(os.getpid()), arena.join(os.getpid())
    parts = (b"p" * 100_000,)
    refs = [SlotRef.parse((reader.announce(parts) or b"")[-28:]) for reader in (first, second)]
    assert refs[0] == refs[1]
    views = [window.take(refs[0], reader.number) for reader in (first, second)]
    views.pop()
    assert arena.busy_slots == 1
    views.pop()
    assert arena.busy_slots == 0
    arena.forget_last()


def test_what_was_put_may_change_once_it_is_forgotten(arena: Arena) -> None:
    window = window_to(arena)
    reader = arena.join(os.getpid())
    content = bytearray(b"a" * 100_000)
    parts = (content,)
    first = window.take(SlotRef.parse((reader.announce(parts) or b"")[-28:]), reader.number)
    arena.forget_last()
    content[:] = b"b" * 100_000
    second = window.take(SlotRef.parse((reader.announce(parts) or b"")[-28:]), reader.number)
    assert (first[0], second[0]) == (ord("a"), ord("b"))


def test_beyond_the_limit_nothing_is_shared_and_free_slots_of_another_size_make_room(
    arena: Arena,
) -> None:
    window = window_to(arena)
    reader = arena.join(os.getpid())
    small = [window.take(announced(reader, bytes(MIB)), reader.number) for _ in range(8)]
    assert reader.announce((bytes(MIB),)) is None
    small.clear()
    large = window.take(announced(reader, b"l" * 6 * MIB), reader.number)
    assert arena.shared_bytes <= 8 * MIB
    assert bytes(large[-3:]) == b"lll"


def test_a_reader_that_left_keeps_what_it_holds(arena: Arena) -> None:
    window = window_to(arena)
    reader = arena.join(os.getpid())
    view = window.take(announced(reader, b"k" * 100_000), reader.number)
    arena.leave(reader)
    assert not arena.is_unused
    other = arena.join(os.getpid())
    assert other.number != reader.number
    announced(other, b"n" * 100_000)
    assert bytes(view[:1]) == b"k"
    del view
    arena.leave(other)
    assert arena.busy_slots == 1, "the other reader never let go of its own"


def test_a_dead_process_holds_nothing(arena: Arena) -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        reader = arena.join(process.pid)
        announced(reader, b"d" * 100_000)
        arena.leave(reader)
        assert arena.busy_slots == 1
        process.kill()
        process.wait()
    assert arena.busy_slots == 0
    assert arena.is_unused


def test_a_reader_that_is_behind_says_when_it_has_caught_up(arena: Arena) -> None:
    window = window_to(arena)
    reader = arena.join(os.getpid())
    slots = [announced(reader, bytes(2 * MIB)).slot]
    assert not reader.is_behind_for_now()
    assert not window.handed_on([], reader.number)
    slots.append(announced(reader, bytes(2 * MIB)).slot)
    assert reader.is_behind_for_now()
    assert window.handed_on(slots[:1], reader.number)
    assert not reader.is_behind_for_now()
    assert not window.handed_on(slots[1:], reader.number)


def test_the_view_of_a_forked_process_is_not_counted(arena: Arena) -> None:
    window = window_to(arena)
    reader = arena.join(os.getpid())
    view = window.take(announced(reader, b"f" * 100_000), reader.number)
    pid = os.fork()
    if not pid:
        del view
        os._exit(0)
    os.waitpid(pid, 0)
    assert arena.busy_slots == 1
    assert bytes(view[:1]) == b"f"


def test_only_so_many_readers_and_only_of_living_processes(arena: Arena) -> None:
    readers = [arena.join(os.getpid()) for _ in range(64)]
    with pytest.raises(OSError, match="64 links"):
        arena.join(os.getpid())
    for reader in readers:
        arena.leave(reader)
        arena.leave(reader)
    with pytest.raises(ProcessLookupError):
        arena.join(2**22 + 1)


def test_a_slot_outside_of_the_file_is_refused(arena: Arena) -> None:
    window = window_to(arena)
    with pytest.raises(FrameError, match="outside"):
        window.take(SlotRef(0, TABLE_BYTES, 65536, 10), 0)
    empty = os.memfd_create("empty")
    with pytest.raises(OSError, match="map"):
        Window.shared(b"another identity", empty)


def test_the_limit_is_said_in_mib(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("SIMPLE_ROS_SHM_MB", "12")
    assert arenas.limit_bytes() == 12 * MIB
    monkeypatch.setenv("SIMPLE_ROS_SHM_MB", "much")
    assert arenas.limit_bytes() == 256 * MIB
    assert "SIMPLE_ROS_SHM_MB=much" in caplog.text

"""Bag files: written, read, damaged, recovered, rewritten."""

from __future__ import annotations

import errno
import random
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from support.bags import DEFINITION, SECOND, START_NS, make_bag, text, texts

from simple_ros.bag import (
    Bag,
    BagDamaged,
    BagExists,
    BagUnavailable,
    BagWriter,
    DiskFull,
    NotABag,
    RecordedTopic,
    SeriesOptions,
    SplitRule,
)
from simple_ros.bag.chunks import Compression
from simple_ros.bag.examination import examine
from simple_ros.bag.information import inspect
from simple_ros.bag.ordering import in_order
from simple_ros.bag.plan import LatchedHistory
from simple_ros.bag.recovery import recover
from simple_ros.bag.rewriting import Rewriting, rewrite
from simple_ros.bag.series import DROPS, RECORDING, BagSeries
from simple_ros.cli.bag.rewriting import filter_messages
from simple_ros.errors import UnknownMessageType
from simple_ros.msg.std_msgs import String

NUMBERS = [("numbers", index / 10, str(index)) for index in range(100)]


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
class TestWriter:
    def test_the_library_reads_what_we_write(
        self, tmp_path: Path, compression: Compression
    ) -> None:
        path = make_bag(tmp_path / "a.mcap", NUMBERS, compression=compression, flush_every=7)
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            found = list(reader.iter_messages())
            summary = reader.get_summary()
        assert [String.FromString(message.data).data for _, _, message in found] == [
            data for _, _, data in NUMBERS
        ]
        schema, channel, last = found[-1]
        assert schema is not None
        assert (schema.name, schema.encoding, schema.data) == (
            "std_msgs.String",
            "protobuf",
            DEFINITION,
        )
        assert (channel.topic, channel.message_encoding) == ("numbers", "protobuf")
        assert (last.log_time, last.sequence) == (START_NS + 99 * SECOND // 10, 99)
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 100
        assert summary.statistics.chunk_count == 15

    def test_we_read_what_the_library_writes(
        self, tmp_path: Path, compression: Compression
    ) -> None:
        path = tmp_path / "theirs.mcap"
        with path.open("wb") as file:
            kind = CompressionType[compression.upper()]
            writer = Writer(file, chunk_size=200, compression=kind)
            writer.start()
            schema = writer.register_schema("std_msgs.String", "protobuf", DEFINITION)
            channel = writer.register_channel("numbers", "protobuf", schema)
            for index in random.Random(7).sample(range(50), 50):
                writer.add_message(channel, index, text(str(index)), index)
            writer.finish()
        assert texts(path) == [str(index) for index in range(50)]
        found = examine(path)
        assert (found.errors, found.messages) == ([], 50)


class TestReader:
    def test_parts(self, tmp_path: Path) -> None:
        mixed = [item for n in NUMBERS for item in (n, ("odd", n[1], "x" + n[2]))]
        path = make_bag(tmp_path / "a.mcap", mixed, flush_every=16)
        with Bag(path) as bag:
            assert sorted(topic.name for topic in bag.topics.values()) == ["numbers", "odd"]
            assert bag.message_count == 200
            part = bag.messages(["/odd"], start_ns=START_NS + SECOND, end_ns=START_NS + 2 * SECOND)
            found = [message.decoded() for message in part]
            assert [message.data for message in found] == [f"x{n}" for n in range(10, 20)]  # type: ignore[attr-defined]

    def test_the_last_before_a_time(self, tmp_path: Path) -> None:
        rare = [("map", 0.05, "old"), ("map", 1.05, "new"), ("map", 8.0, "newest")]
        path = make_bag(
            tmp_path / "a.mcap", sorted([*NUMBERS, *rare], key=lambda m: m[1]), flush_every=5
        )
        with Bag(path) as bag:
            last = bag.last_before(["map", "numbers", "none"], START_NS + 5 * SECOND)
            assert [(m.topic.name, text_of(m.data)) for m in last] == [
                ("map", "new"),
                ("numbers", "49"),
            ]
            several = bag.last_before(["map", "numbers"], START_NS + 5 * SECOND, most=3)
            assert [text_of(m.data) for m in several] == ["old", "new", "47", "48", "49"]

    def test_several_in_order(self, tmp_path: Path) -> None:
        odd = make_bag(tmp_path / "odd.mcap", [m for m in NUMBERS if int(m[2]) % 2])
        even = make_bag(tmp_path / "even.mcap", [m for m in NUMBERS if not int(m[2]) % 2])
        empty = make_bag(tmp_path / "empty.mcap", [])
        with Bag(odd) as one, Bag(even) as two, Bag(empty) as three:
            found = [text_of(m.data) for _, m in in_order([one, two, three], Bag.messages)]
        assert found == [str(index) for index in range(100)]

    def test_a_type_without_definition(self, tmp_path: Path) -> None:
        with BagWriter(tmp_path / "a.mcap") as writer:
            schema = writer.add_schema("x.Y", "", b"")
            writer.add(writer.add_channel("y", schema), 1, [b"?"])
        with Bag(tmp_path / "a.mcap") as bag:
            (message,) = bag.messages()
            assert message.data == b"?"
            with pytest.raises(UnknownMessageType, match=r"x\.Y"):
                message.decoded()

    def test_what_is_no_bag(self, tmp_path: Path) -> None:
        path = tmp_path / "x.mcap"
        with pytest.raises(BagUnavailable, match=r"x\.mcap: No such file"):
            Bag(path)
        for content, reason in [
            (b"", "it is empty"),
            (b"hello world", "it begins with b'hello wo'"),
            (b"\x89MCAP1\r\n", "it is MCAP of version '1', not '0'"),
            (b"#ROSBAG V2.0\n", "it is a ROS 1 bag; 'simple-ros bag convert"),
            (b"SQLite format 3\0", "it is a ROS 2 bag"),
        ]:
            path.write_bytes(content)
            with pytest.raises(NotABag, match=reason):
                Bag(path)

    def test_a_file_without_index_is_told_what_to_do(self, tmp_path: Path) -> None:
        path = tmp_path / "plain.mcap"
        with path.open("wb") as file:
            writer = Writer(file, use_chunking=False)
            writer.start()
            schema = writer.register_schema("std_msgs.String", "protobuf", DEFINITION)
            channel = writer.register_channel("numbers", "protobuf", schema)
            for index in range(50):
                writer.add_message(channel, index, text(str(index)), index, index)
            writer.finish()
        with pytest.raises(BagDamaged, match=r"no index; 'simple-ros bag recover .* OUT\.mcap'"):
            Bag(path)
        assert recover(path, tmp_path / "ours.mcap").damage == ()
        assert texts(tmp_path / "ours.mcap") == [str(index) for index in range(50)]


def text_of(data: bytes) -> str:
    return String.FromString(data).data


class TestNames:
    def test_nothing_is_overwritten(self, tmp_path: Path) -> None:
        path = make_bag(tmp_path / "a.mcap", NUMBERS)
        with pytest.raises(BagExists):
            BagWriter(path)
        with BagWriter(tmp_path / "b.mcap") as writer:
            assert writer.active_path == tmp_path / "b.mcap.active"
            with pytest.raises(BagExists, match=r"b\.mcap\.active exists"):
                BagWriter(tmp_path / "b.mcap")
            assert not writer.path.exists()
        assert sorted(file.name for file in tmp_path.iterdir()) == ["a.mcap", "b.mcap"]

    def test_a_file_that_came_meanwhile_stays(self, tmp_path: Path) -> None:
        writer = BagWriter(tmp_path / "a.mcap")
        (tmp_path / "a.mcap").write_text("mine")
        with pytest.raises(BagExists):
            writer.finish()
        assert (tmp_path / "a.mcap").read_text() == "mine"
        assert (tmp_path / "a.mcap.active").exists()

    def test_a_disk_that_fails(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        writer = BagWriter(tmp_path / "a.mcap")
        writer.add(writer.add_channel("t", 0), 1, [b"x"])

        def broken(_: int) -> None:
            raise OSError(errno.EIO, "Input/output error")

        monkeypatch.setattr("os.fsync", broken)
        with pytest.raises(BagUnavailable, match=r"a\.mcap\.active: Input/output error"):
            writer.flush()
        monkeypatch.undo()
        with Bag(writer.finish()) as bag:
            assert [message.data for message in bag.messages()] == [b"x"]

    def test_no_such_directory(self, tmp_path: Path) -> None:
        with pytest.raises(BagUnavailable, match="No such file or directory"):
            BagWriter(tmp_path / "none" / "a.mcap")


class TestDamage:
    def test_any_prefix_gives_all_it_holds(self, tmp_path: Path) -> None:
        whole = make_bag(tmp_path / "a.mcap", NUMBERS, flush_every=10)
        content = whole.read_bytes()
        chance = random.Random(3)
        for number, size in enumerate(sorted(chance.sample(range(8, len(content)), 40))):
            path, out = tmp_path / "cut.mcap", tmp_path / f"out{number}.mcap"
            path.write_bytes(content[:size])
            with pytest.raises(BagDamaged):
                Bag(path)
            found = recover(path, out)
            kept = texts(out)
            assert not found.was_ended
            assert len(kept) == found.messages
            assert kept == [str(index) for index in range(len(kept))]
            assert len(kept) % 10 == 0

    def test_any_byte_may_be_wrong(self, tmp_path: Path) -> None:
        content = make_bag(tmp_path / "a.mcap", NUMBERS, flush_every=10).read_bytes()
        chance = random.Random(5)
        for number in range(60):
            damaged = bytearray(content)
            damaged[chance.randrange(8, len(content))] ^= 1 << chance.randrange(8)
            path, out = tmp_path / "bad.mcap", tmp_path / f"out{number}.mcap"
            path.write_bytes(damaged)
            examine(path)
            recover(path, out)
            assert set(texts(out)) <= {str(index) for index in range(100)}
            try:
                texts(path)
            except (BagDamaged, LookupError):
                pass

    def test_a_bad_chunk_is_left_out_and_reading_goes_on(self, tmp_path: Path) -> None:
        path = make_bag(tmp_path / "a.mcap", NUMBERS, flush_every=25, compression="none")
        content = bytearray(path.read_bytes())
        place = content.index(text("30"))
        content[place + 2] = ord("x")
        path.write_bytes(content)
        finding, after = examine(path).errors
        assert finding.reason == "a chunk fails its checksum"
        assert after.reason == "there are 75 messages, the end of the file says 100"
        with pytest.raises(BagDamaged, match="checksum") as caught:
            texts(path)
        assert caught.value.offset == finding.offset
        found = recover(path, tmp_path / "out.mcap")
        assert (found.messages, found.chunks, found.was_ended) == (75, 3, True)
        assert found.lost_bytes > 0
        assert [damage.offset for damage in found.damage] == [finding.offset]

    def test_recover_keeps_the_rest(self, tmp_path: Path) -> None:
        with BagWriter(tmp_path / "a.mcap") as writer:
            writer.note("custom", {"run": "7"})
            writer.attach("map.yaml", "application/yaml", b"resolution: 0.05\n", 5)
            writer.add(writer.add_channel("t", 0), 9, [b"x"])
            writer.flush()
            unfinished = tmp_path / "copy.mcap"
            unfinished.write_bytes(writer.active_path.read_bytes())
        found = recover(unfinished, tmp_path / "out.mcap")
        assert (found.messages, found.damage, found.was_ended) == (1, (), False)
        with Bag(tmp_path / "out.mcap") as bag:
            assert bag.metadata() == {"custom": {"run": "7"}}
            (item,) = bag.attachments()
            assert (item.name, item.data) == ("map.yaml", b"resolution: 0.05\n")

    def test_a_damaged_attachment_is_left_out(self, tmp_path: Path) -> None:
        with BagWriter(tmp_path / "a.mcap") as writer:
            writer.attach("map.yaml", "application/yaml", b"resolution: 0.05\n", 5)
        content = bytearray(writer.path.read_bytes())
        content[content.index(b"0.05")] = ord("9")
        writer.path.write_bytes(content)
        found = recover(writer.path, tmp_path / "out.mcap")
        (damage,) = found.damage
        assert damage.reason == "an attachment fails its checksum"
        with Bag(tmp_path / "out.mcap") as bag:
            assert bag.attachment_names == []

    def test_a_doctor_sees_a_wrong_end(self, tmp_path: Path) -> None:
        path = make_bag(tmp_path / "a.mcap", NUMBERS)
        assert examine(path).errors == []
        content = path.read_bytes()
        path.write_bytes(content + b"more")
        assert [found.reason for found in examine(path).errors] == [
            "the file does not end where its footer ends"
        ]


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


class TestFullDisk:
    @pytest.mark.parametrize("limit", [6_000, 10_000, 33_333])
    def test_the_file_ends_cleanly(self, tmp_path: Path, limit: int) -> None:
        path = tmp_path / "a.mcap"
        noise = random.Random(1)
        with largest_file(limit):
            writer = BagWriter(path)
            schema = writer.add_schema("std_msgs.String", "protobuf", DEFINITION)
            channel = writer.add_channel("numbers", schema)
            with pytest.raises(DiskFull, match=r"a\.mcap\.active: cannot write on: File too large"):
                for index in range(1000):
                    padding = "".join(chr(noise.randrange(32, 127)) for _ in range(80))
                    writer.add(channel, START_NS + index, [text(f"{index} {padding}")])
                    if index % 5 == 4:
                        writer.flush()
            writer.finish()
        found = examine(path)
        assert (found.errors, found.messages) == ([], writer.message_count)
        kept = [data.split()[0] for data in texts(path)]
        assert kept == [str(index) for index in range(len(kept))]
        assert path.stat().st_size <= limit

    def test_no_room_for_an_end(self, tmp_path: Path) -> None:
        with largest_file(1_500):
            writer = BagWriter(tmp_path / "a.mcap")
            writer.add_schema("std_msgs.String", "protobuf", bytes(1_000))
            with pytest.raises(DiskFull):
                writer.finish()
        assert list(tmp_path.iterdir()) == []

    def test_no_room_at_all(self, tmp_path: Path) -> None:
        with largest_file(10), pytest.raises(DiskFull):
            BagWriter(tmp_path / "a.mcap")
        assert list(tmp_path.iterdir()) == []


class TestSeries:
    def test_splits_repeat_what_is_latched(self, tmp_path: Path) -> None:
        options = SeriesOptions(
            tmp_path / "run.mcap", split=SplitRule(max_duration_s=1.0), facts={"host": "here"}
        )
        series = BagSeries(options)
        chart = RecordedTopic(
            "map", "std_msgs.String", DEFINITION, {"latched": "true"}, LatchedHistory()
        )
        numbers = RecordedTopic("numbers", "std_msgs.String", DEFINITION)
        series.add(chart, START_NS, [text("the map")])
        for _, after_s, data in NUMBERS[:25]:
            series.add(numbers, START_NS + round(after_s * SECOND), [text(data)])
        series.finish({"numbers": 3, "map": 0})
        names = [f"run_{index}.mcap" for index in range(3)]
        assert [path.name for path in series.finished] == names
        assert series.message_count == 26
        assert [texts(path)[0] for path in series.finished] == ["the map"] * 3
        second = inspect(series.finished[1])
        assert second.metadata[RECORDING] == {"host": "here", "split": "1"}
        last = inspect(series.finished[2])
        assert last.metadata[DROPS] == {"numbers": "3"}
        assert [(topic.name, topic.count, topic.dropped) for topic in last.topics] == [
            ("map", 1, 0),
            ("numbers", 5, 3),
        ]
        with Bag(series.finished[1]) as bag:
            repeated = next(bag.messages(["map"]))
            assert repeated.log_time == START_NS + SECOND
            assert repeated.publish_time == START_NS

    def test_the_oldest_files_go(self, tmp_path: Path) -> None:
        options = SeriesOptions(
            tmp_path / "run.mcap", split=SplitRule(max_duration_s=1.0), max_files=2
        )
        series = BagSeries(options)
        numbers = RecordedTopic("numbers", "std_msgs.String", DEFINITION)
        for _, after_s, data in NUMBERS[:45]:
            series.add(numbers, START_NS + round(after_s * SECOND), [text(data)])
        series.finish({})
        assert sorted(path.name for path in tmp_path.iterdir()) == ["run_3.mcap", "run_4.mcap"]

    def test_by_size(self, tmp_path: Path) -> None:
        options = SeriesOptions(tmp_path / "run.mcap", "none", split=SplitRule(max_bytes=200_000))
        series = BagSeries(options)
        noise = RecordedTopic("noise", "std_msgs.String", DEFINITION)
        for index in range(100):
            series.add(noise, START_NS + index, [bytes(10_000)])
        series.finish({})
        sizes = [path.stat().st_size for path in series.finished]
        assert len(sizes) > 3
        assert max(sizes) < 300_000

    def test_leaves_room_on_the_disk(self, tmp_path: Path) -> None:
        with pytest.raises(DiskFull, match="--min-free leaves"):
            BagSeries(SeriesOptions(tmp_path / "a.mcap", min_free_bytes=10**18))
        assert list(tmp_path.iterdir()) == []


class TestInformation:
    def test_counts_rates_and_gaps(self, tmp_path: Path) -> None:
        with_gap = [m for m in NUMBERS if not 30 <= int(m[2]) < 50]
        path = make_bag(tmp_path / "a.mcap", with_gap, flush_every=11, latched=["numbers"])
        found = inspect(path)
        (topic,) = found.topics
        assert (found.message_count, found.duration_s) == (80, 9.9)
        assert (topic.name, topic.msg_type, topic.latched) == ("numbers", "std_msgs.String", True)
        assert (topic.first_ns, topic.last_ns) == (found.start_ns, found.end_ns)
        assert topic.rate_hz == pytest.approx(79 / 9.9)
        (gap,) = topic.gaps
        assert (gap.start_s, gap.duration_s) == (pytest.approx(2.9), pytest.approx(2.1))

    def test_empty(self, tmp_path: Path) -> None:
        found = inspect(make_bag(tmp_path / "a.mcap", []))
        assert (found.message_count, found.duration_s, found.topics) == (0, 0.0, ())


class TestRewriting:
    def test_parts_and_joins(self, tmp_path: Path) -> None:
        path = make_bag(tmp_path / "a.mcap", [*NUMBERS[:50], ("other", 5.0, "!")])
        part = tmp_path / "part.mcap"
        how = Rewriting(lambda topic: topic == "numbers", start_s=1.0, end_s=2.0, compression="lz4")
        assert rewrite([path], part, how) == 10
        assert texts(part) == [str(index) for index in range(10, 20)]
        rest = make_bag(tmp_path / "b.mcap", NUMBERS[50:])
        joined = tmp_path / "joined.mcap"
        assert rewrite([rest, path], joined, Rewriting()) == 101
        assert texts(joined, "numbers") == [str(index) for index in range(100)]
        assert examine(joined).errors == []
        with Bag(joined) as bag:
            assert len(bag.topics) == 2

    def test_a_part_with_nothing_in_it_is_told(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        path = make_bag(tmp_path / "a.mcap", NUMBERS)
        filter_messages(path, tmp_path / "part.mcap", ["nothing"])
        told = capsys.readouterr()
        assert told.err.startswith(f"warning: {path} has no message of that time and those topics")
        assert told.out == f"wrote {tmp_path / 'part.mcap'}: 0 messages\n"

    def test_facts_and_files_are_taken_over(self, tmp_path: Path) -> None:
        paths = []
        for index in range(2):
            with BagWriter(tmp_path / f"{index}.mcap") as writer:
                writer.note("custom", {"run": str(index)})
                writer.note(DROPS, {"a": "2"})
                writer.attach("same", "text/plain", b"same", 1)
                writer.attach("robot", "text/plain", str(index).encode(), 1)
            paths.append(writer.path)
        out = tmp_path / "out.mcap"
        assert rewrite(paths, out, Rewriting()) == 0
        with Bag(out) as bag:
            assert bag.metadata() == {
                "custom": {"run": "0"},
                "custom.2": {"run": "1"},
                DROPS: {"a": "4"},
            }
            assert bag.attachment_names == ["same", "robot", "robot"]

    def test_a_damaged_source_leaves_nothing(self, tmp_path: Path) -> None:
        path = make_bag(tmp_path / "a.mcap", NUMBERS, compression="none")
        content = bytearray(path.read_bytes())
        content[content.index(text("30"))] ^= 1
        path.write_bytes(content)
        with pytest.raises(BagDamaged):
            rewrite([path], tmp_path / "b.mcap", Rewriting())
        assert [file.name for file in tmp_path.iterdir()] == ["a.mcap"]

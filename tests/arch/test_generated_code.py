"""Generated code is fresh, made by the oldest toolchain, and true to the wire of C++ simple_ros."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

from simple_ros.msg import example, geometry_msgs, ustc, visualization_msgs
from simple_ros.msg.registry import MsgFactory

ROOT = Path(__file__).resolve().parents[2]
GENERATE = ROOT / "proto" / "generate.py"

# Name, number and type of each field that C++ simple_ros knows. Nothing in here may ever change.
SEED_FIELDS = {
    "example.SensorData": [
        ("sensor_id", 1, "int32"),
        ("value", 2, "float"),
        ("timestamp", 3, "int64"),
    ],
    "example.ControlCommand": [("cmd_id", 1, "int32"), ("cmd", 2, "string")],
    "example.Heartbeat": [("timestamp", 1, "int64")],
    "ustc.Pose": [("x", 1, "double"), ("y", 2, "double"), ("z", 3, "double")],
    "geometry_msgs.Point": [("x", 1, "double"), ("y", 2, "double"), ("z", 3, "double")],
    "geometry_msgs.Quaternion": [
        ("x", 1, "double"),
        ("y", 2, "double"),
        ("z", 3, "double"),
        ("w", 4, "double"),
    ],
    "geometry_msgs.Pose": [
        ("position", 1, "geometry_msgs.Point"),
        ("orientation", 2, "geometry_msgs.Quaternion"),
    ],
    "geometry_msgs.Vector3": [("x", 1, "double"), ("y", 2, "double"), ("z", 3, "double")],
    "geometry_msgs.Odometry": [
        ("pose", 1, "geometry_msgs.Pose"),
        ("linear_velocity", 2, "geometry_msgs.Vector3"),
        ("angular_velocity", 3, "geometry_msgs.Vector3"),
    ],
    "visualization_msgs.ColorRGBA": [
        ("r", 1, "float"),
        ("g", 2, "float"),
        ("b", 3, "float"),
        ("a", 4, "float"),
    ],
    "visualization_msgs.Marker": [
        ("ns", 1, "string"),
        ("id", 2, "int32"),
        ("type", 3, "visualization_msgs.MarkerType"),
        ("action", 4, "visualization_msgs.MarkerAction"),
        ("pose", 5, "geometry_msgs.Pose"),
        ("scale", 6, "geometry_msgs.Vector3"),
        ("color", 7, "visualization_msgs.ColorRGBA"),
        ("lifetime", 8, "double"),
        ("text", 9, "string"),
        ("mesh_resource", 10, "string"),
        ("mesh_use_embedded_materials", 11, "bool"),
        ("points", 12, "repeated geometry_msgs.Point"),
        ("colors", 13, "repeated visualization_msgs.ColorRGBA"),
    ],
    "visualization_msgs.MarkerArray": [("markers", 1, "repeated visualization_msgs.Marker")],
}
FIRST_FREE_NUMBER = {"visualization_msgs.Marker": 20}

SEED_ENUMS = {
    visualization_msgs.MarkerType: [
        ("CUBE", 0),
        ("SPHERE", 1),
        ("CYLINDER", 2),
        ("ARROW", 3),
        ("LINE_STRIP", 4),
        ("POINTS", 5),
        ("TEXT_VIEW_FACING", 6),
        ("MESH_RESOURCE", 7),
    ],
    visualization_msgs.MarkerAction: [("ADD", 0), ("DELETE", 1), ("DELETEALL", 2)],
}


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("simple_ros_generate", GENERATE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def fresh(
    generator: ModuleType, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, list[Path]]:
    """A folder with newly made code and the names of all files in it."""
    try:
        generator.require_toolchain()
    except generator.ToolchainError as error:
        pytest.skip(str(error))
    out = tmp_path_factory.mktemp("generated")
    return out, generator.generate(out)


def _type_name(field: object) -> str:
    kinds = {1: "double", 2: "float", 3: "int64", 5: "int32", 8: "bool", 9: "string"}
    named = field.message_type or field.enum_type
    name = named.full_name if named else kinds[field.type]
    return f"repeated {name}" if field.is_repeated else name


class TestFreshness:
    def test_committed_code_is_what_the_proto_files_give(self, generator, fresh) -> None:
        out, files = fresh
        assert generator.differences(out, files, ROOT) == []

    def test_every_proto_file_gives_code_and_stub(self, fresh) -> None:
        _, files = fresh
        stems = [p.relative_to(ROOT / "proto") for p in (ROOT / "proto").rglob("*.proto")]
        assert stems
        for stem in stems:
            assert stem.with_name(f"{stem.stem}_pb2.py") in files
            assert stem.with_name(f"{stem.stem}_pb2.pyi") in files

    def test_two_runs_give_the_same_bytes(self, generator, fresh, tmp_path) -> None:
        out, files = fresh
        assert generator.generate(tmp_path) == files
        assert generator.differences(out, files, tmp_path) == []

    def test_differences_are_named(self, generator, fresh, tmp_path) -> None:
        out, files = fresh
        generator.generate(tmp_path)
        msg = tmp_path / "simple_ros" / "msg"
        (msg / "ustc_pb2.py").write_text("changed")
        (msg / "example.py").unlink()
        (msg / "gone_pb2.pyi").write_text("")
        (msg / "gone.py").write_text(generator.FACADE_MARK)
        (msg / "by_hand.py").write_text("")
        assert generator.differences(out, files, tmp_path) == [
            "missing: simple_ros/msg/example.py",
            "differs: simple_ros/msg/ustc_pb2.py",
            "left over: simple_ros/msg/gone.py",
            "left over: simple_ros/msg/gone_pb2.pyi",
        ]

    def test_writing_removes_what_lost_its_proto_file(
        self, generator, fresh, tmp_path, capsys
    ) -> None:
        stale = tmp_path / "simple_ros" / "msg" / "gone_pb2.py"
        stale.parent.mkdir(parents=True)
        stale.write_text("")
        assert generator.main(["--out", str(tmp_path)]) == 0
        assert not stale.exists()
        assert "gone_pb2.py" in capsys.readouterr().out


class TestToolchain:
    @pytest.mark.parametrize("found", ["1.75.0", "1.7.4", "2.0"])
    def test_wrong_version_says_what_to_install(
        self, generator, monkeypatch, capsys, found
    ) -> None:
        monkeypatch.setattr(generator, "version", lambda package: found)
        assert generator.main(["--check"]) == 2
        assert "pip install 'grpcio-tools==1.74.*'" in capsys.readouterr().err

    def test_missing_package_says_what_to_install(self, generator, monkeypatch, capsys) -> None:
        def missing(package: str) -> str:
            raise generator.PackageNotFoundError(package)

        monkeypatch.setattr(generator, "version", missing)
        assert generator.main(["--check"]) == 2
        assert "is not installed; run: pip install" in capsys.readouterr().err

    @pytest.mark.parametrize(
        "path", sorted(ROOT.glob("simple_ros/**/*_pb2.py")), ids=lambda p: p.stem
    )
    def test_code_is_made_for_the_oldest_supported_runtime(self, path: Path) -> None:
        text = path.read_text(encoding="utf-8")
        call = re.search(r"ValidateProtobufRuntimeVersion\(([^)]*)\)", text)
        assert call is not None
        assert re.findall(r"\b\d+\b", call[1])[:3] == ["6", "31", "1"]

    def test_no_init_file_hides_the_proto_package_of_others(self) -> None:
        assert not list((ROOT / "proto").rglob("__init__.py"))


class TestSeedWire:
    @pytest.mark.parametrize("name", SEED_FIELDS)
    def test_field_numbers_and_types_are_pinned(self, name: str) -> None:
        fields = MsgFactory().get_class(name).DESCRIPTOR.fields
        pinned = SEED_FIELDS[name]
        known = [(f.name, f.number, _type_name(f)) for f in fields][: len(pinned)]
        assert known == pinned
        assert all(f.number >= FIRST_FREE_NUMBER[name] for f in fields[len(pinned) :])

    @pytest.mark.parametrize("enum", SEED_ENUMS, ids=lambda enum: enum.DESCRIPTOR.name)
    def test_enum_values_are_pinned(self, enum) -> None:
        pinned = SEED_ENUMS[enum]
        assert enum.items()[: len(pinned)] == pinned
        assert all(number >= 20 for _, number in enum.items()[len(pinned) :])

    def test_odometry_of_the_quad_simulator(self) -> None:
        odometry = geometry_msgs.Odometry(
            pose=geometry_msgs.Pose(
                position=geometry_msgs.Point(x=2.0, y=1.0, z=0.5),
                orientation=geometry_msgs.Quaternion(x=0.5, y=0.5, z=0.5, w=0.5),
            ),
            linear_velocity=geometry_msgs.Vector3(x=1.0, y=2.0, z=-0.5),
        )
        odometry.angular_velocity.SetInParent()
        golden = """
            0a43
              0a1b 090000000000000040 11000000000000f03f 19000000000000e03f
              1224 09000000000000e03f 11000000000000e03f 19000000000000e03f 21000000000000e03f
            121b 09000000000000f03f 110000000000000040 19000000000000e0bf
            1a00
        """
        wire = odometry.SerializeToString()
        assert wire == bytes.fromhex(golden)
        assert len(wire) == 100
        assert geometry_msgs.Odometry.FromString(wire).HasField("angular_velocity")

    @pytest.mark.parametrize(
        ("message", "golden"),
        [
            (example.SensorData(sensor_id=1, value=0.5, timestamp=300), "0801 150000003f 18ac02"),
            (example.ControlCommand(cmd_id=-1, cmd="go"), "08ffffffffffffffffff01 1202676f"),
            (example.Heartbeat(timestamp=1), "0801"),
            (ustc.Pose(y=1.0), "11000000000000f03f"),
            (
                visualization_msgs.Marker(ns="q", id=7, type="LINE_STRIP", lifetime=-1.0, text="t"),
                "0a0171 1007 1804 41000000000000f0bf 4a0174",
            ),
            (visualization_msgs.MarkerArray(markers=[visualization_msgs.Marker(id=1)]), "0a021001"),
        ],
        ids=lambda value: value if isinstance(value, str) else type(value).__name__,
    )
    def test_golden_bytes(self, message, golden: str) -> None:
        assert message.SerializeToString() == bytes.fromhex(golden)

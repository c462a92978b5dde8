"""Poses, sensors, logs and diagnostics for Foxglove's panels; the definitions that go with them."""

from __future__ import annotations

import math
from typing import TypeVar

import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log as FoxgloveLog
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.json_format import MessageToDict
from google.protobuf.message import DecodeError, Message
from google.protobuf.timestamp_pb2 import Timestamp
from hypothesis import given, settings
from hypothesis import strategies as st

from simple_ros.foxglove.convert import (
    Context,
    ConversionFailed,
    Converter,
    converters_for,
    convertible_types,
)
from simple_ros.foxglove.convert.ros_names import as_shown, completion_for
from simple_ros.msg import geometry_msgs as geo
from simple_ros.msg import nav_msgs, ustc
from simple_ros.msg.definitions import definition_of
from simple_ros.msg.diagnostic_msgs import DiagnosticArray, DiagnosticStatus, KeyValue
from simple_ros.msg.registry import MsgFactory
from simple_ros.msg.rosgraph_msgs import Log
from simple_ros.msg.sensor_msgs import BatteryState, Imu, JointState, NavSatFix, NavSatStatus
from simple_ros.msg.std_msgs import Header
from simple_ros.msg.tf2_msgs import TFMessage

HEADER = Header(frame_id="odom", stamp=Timestamp(seconds=3, nanos=4))
CONTEXT = Context(5_000_000_006, "/t", "map")
RECEIVED = Timestamp(seconds=5, nanos=6)
EVERY = [(name, c.suffix) for name in convertible_types() for c in converters_for(name)]

M = TypeVar("M", bound=Message)


def converter_of(type_name: str, suffix: str) -> Converter:
    (found,) = (each for each in converters_for(type_name) if each.suffix == suffix)
    return found


def converted(message: Message, suffix: str) -> bytes | None:
    converter = converter_of(message.DESCRIPTOR.full_name, suffix)
    return converter.convert(message.SerializeToString(), CONTEXT)


def shown(message: Message, suffix: str, target: type[M]) -> M:
    result = converted(message, suffix)
    assert result is not None
    return target.FromString(result)


def defined(converter: Converter) -> type[Message]:
    """The class a viewer makes, which knows nothing but what the converter tells."""
    return class_of(converter.schema_name, converter.schema)


def class_of(type_name: str, definition: bytes) -> type[Message]:
    """The class a viewer makes of a definition."""
    files = descriptor_pb2.FileDescriptorSet.FromString(definition)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.AddSerializedFile(file.SerializeToString())
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(type_name))


class TestEveryConverter:
    @pytest.mark.parametrize(("type_name", "suffix"), EVERY)
    def test_its_definition_is_complete_and_fits(self, type_name: str, suffix: str) -> None:
        converter = converter_of(type_name, suffix)
        assert converter.schema_name.startswith(("foxglove.", "ros."))
        target = defined(converter)
        source = MsgFactory.instance().create_message(type_name)
        assert source is not None
        result = converter.convert(source.SerializeToString(), CONTEXT)
        if result is not None:
            assert target.FromString(result).SerializeToString() is not None

    def test_topics_differ(self) -> None:
        assert len(set(EVERY)) == len(EVERY)

    @pytest.mark.parametrize(("type_name", "suffix"), EVERY)
    def test_garbage(self, type_name: str, suffix: str) -> None:
        with pytest.raises(ConversionFailed) as caught:
            converter_of(type_name, suffix).convert(b"\x0a\x7f", CONTEXT)
        assert caught.value.topic == "/t"

    def test_what_nobody_has_to_convert(self) -> None:
        assert converters_for("example.SensorData") == ()


class TestTransforms:
    EDGE = geo.TransformStamped(
        header=HEADER,
        child_frame_id="/base",
        transform=geo.Transform(translation=geo.Vector3(x=1, y=2, z=3)),
    )

    def test_tree(self) -> None:
        edges = shown(TFMessage(transforms=[self.EDGE, self.EDGE]), "/transforms", FrameTransforms)
        assert len(edges.transforms) == 2
        edge = edges.transforms[0]
        assert (edge.parent_frame_id, edge.child_frame_id) == ("odom", "base")
        assert edge.timestamp == HEADER.stamp
        assert (edge.translation.x, edge.translation.y, edge.translation.z) == (1, 2, 3)
        assert edge.rotation.w == 1

    def test_one(self) -> None:
        edge = geo.TransformStamped(child_frame_id="base")
        edge.transform.rotation.z = -1
        (found,) = shown(edge, "/transforms", FrameTransforms).transforms
        assert (found.parent_frame_id, found.timestamp) == ("map", RECEIVED)
        assert (found.rotation.z, found.rotation.w) == (-1, 0)


def pose(x: float = 1, **turn: float) -> geo.Pose:
    return geo.Pose(position=geo.Point(x=x, y=2, z=3), orientation=geo.Quaternion(**turn))


class TestPoses:
    @pytest.mark.parametrize(
        ("message", "frame", "stamp"),
        [
            (geo.PoseStamped(header=HEADER, pose=pose()), "odom", HEADER.stamp),
            (
                geo.PoseWithCovarianceStamped(
                    header=HEADER, pose=geo.PoseWithCovariance(pose=pose())
                ),
                "odom",
                HEADER.stamp,
            ),
            (
                nav_msgs.Odometry(header=HEADER, pose=geo.PoseWithCovariance(pose=pose())),
                "odom",
                HEADER.stamp,
            ),
            (geo.Odometry(pose=pose()), "map", RECEIVED),
            (ustc.Pose(x=1, y=2, z=3), "map", RECEIVED),
        ],
    )
    def test_one(self, message: Message, frame: str, stamp: Timestamp) -> None:
        found = shown(message, "/pose", PoseInFrame)
        assert (found.frame_id, found.timestamp) == (frame, stamp)
        at, turn = found.pose.position, found.pose.orientation
        assert (at.x, at.y, at.z) == (1, 2, 3)
        assert (turn.x, turn.y, turn.z, turn.w) == (0, 0, 0, 1)

    def test_a_turn_is_kept(self) -> None:
        found = shown(geo.Odometry(pose=pose(x=0, z=0.6, w=0.8)), "/pose", PoseInFrame)
        turn = found.pose.orientation
        assert (turn.x, turn.y, turn.z, turn.w) == (0, 0, 0.6, 0.8)

    def test_array(self) -> None:
        poses = geo.PoseArray(header=HEADER, poses=[pose(x=4), pose(z=0.6, w=0.8)])
        found = shown(poses, "/poses", PosesInFrame)
        assert [
            (each.position.x, each.orientation.z, each.orientation.w) for each in found.poses
        ] == [
            (4, 0, 1),
            (1, 0.6, 0.8),
        ]
        assert found.frame_id == "odom"

    @settings(deadline=None, derandomize=True)
    @given(st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(-1, 1)), max_size=30))
    def test_any_path(self, values: list[tuple[float, float]]) -> None:
        stamped = [geo.PoseStamped(pose=pose(x=x, z=z, w=1)) for x, z in values]
        path = nav_msgs.Path(header=HEADER, poses=stamped)
        found = shown(path, "/poses", PosesInFrame)
        assert [(each.position.x, each.orientation.z) for each in found.poses] == values
        (entity,) = shown(path, "/scene", SceneUpdate).entities
        assert [point.x for point in entity.lines[0].points] == [x for x, _ in values]

    def test_a_path_in_two_frames(self) -> None:
        poses = [geo.PoseStamped(header=Header(frame_id=name)) for name in ("/odom", "", "camera")]
        for suffix in ("/scene", "/poses"):
            with pytest.raises(ConversionFailed, match="has poses in other frames: camera"):
                converted(nav_msgs.Path(header=HEADER, poses=poses), suffix)

    def test_a_path_whose_poses_only_name_the_frame(self) -> None:
        poses = [geo.PoseStamped(header=Header(frame_id=name)) for name in ("/odom", "", "odom")]
        path = nav_msgs.Path(poses=poses)
        assert shown(path, "/poses", PosesInFrame).frame_id == "odom"
        assert shown(path, "/scene", SceneUpdate).entities[0].frame_id == "odom"
        path.poses.add(header=Header(frame_id="camera"))
        with pytest.raises(ConversionFailed, match="has poses in other frames: camera, odom"):
            converted(path, "/poses")

    def test_polygon(self) -> None:
        corners = [geo.Point32(x=1), geo.Point32(y=math.nan), geo.Point32(z=1)]
        area = geo.PolygonStamped(header=HEADER, polygon=geo.Polygon(points=corners))
        (entity,) = shown(area, "/scene", SceneUpdate).entities
        (line,) = entity.lines
        assert line.type == line.LINE_LOOP
        assert [(point.x, point.z) for point in line.points] == [(1, 0), (0, 1)]
        assert entity.id == "polygon"


class TestImu:
    IMU = Imu(
        header=HEADER,
        orientation=geo.Quaternion(z=0.6, w=0.8),
        linear_acceleration=geo.Vector3(z=10),
        angular_velocity=geo.Vector3(x=2),
    )

    def test_arrows(self) -> None:
        acceleration, turning = shown(self.IMU, "/scene", SceneUpdate).entities
        assert (acceleration.id, acceleration.frame_id) == ("acceleration", "odom")
        (up,), (ahead,) = acceleration.arrows, turning.arrows
        assert up.shaft_length + up.head_length == pytest.approx(1.0)
        assert ahead.shaft_length + ahead.head_length == pytest.approx(1.0)
        assert ahead.pose.orientation.w == 1

    def test_orientation(self) -> None:
        found = shown(self.IMU, "/orientation", PoseInFrame)
        assert (found.frame_id, found.pose.orientation.z) == ("map", 0.6)

    def test_what_the_sensor_does_not_measure(self) -> None:
        imu = Imu()
        imu.CopyFrom(self.IMU)
        imu.orientation_covariance.extend([-1] + [0] * 8)
        imu.linear_acceleration_covariance.extend([-1] + [0] * 8)
        imu.angular_velocity.x = math.nan
        assert converted(imu, "/orientation") is None
        assert not any(entity.arrows for entity in shown(imu, "/scene", SceneUpdate).entities)


class TestNavSatFix:
    FIX = NavSatFix(
        header=HEADER,
        latitude=31.8,
        longitude=117.2,
        altitude=math.nan,
        position_covariance=range(9),
        position_covariance_type=NavSatFix.COVARIANCE_TYPE_KNOWN,
    )

    def test_place(self) -> None:
        fix = shown(self.FIX, "/location", LocationFix)
        assert (fix.latitude, fix.longitude, fix.frame_id) == (31.8, 117.2, "odom")
        assert math.isnan(fix.altitude)
        assert fix.position_covariance_type == LocationFix.KNOWN
        assert list(fix.position_covariance) == list(range(9))

    def test_no_fix(self) -> None:
        for lost in (
            NavSatFix(status=NavSatStatus(status=NavSatStatus.STATUS_NO_FIX)),
            NavSatFix(latitude=math.nan),
        ):
            assert converted(lost, "/location") is None


class TestJoints:
    def test_states(self) -> None:
        state = JointState(header=HEADER, name=["a", "b"], position=[1, 2], effort=[3, 4])
        first, second = shown(state, "/joints", JointStates).joints
        assert (first.name, first.position, first.effort) == ("a", 1, 3)
        assert (second.position, second.HasField("velocity")) == (2, False)

    def test_arrays_that_do_not_fit(self) -> None:
        with pytest.raises(ConversionFailed, match="2 joints have 1 values of velocity"):
            converted(JointState(name=["a", "b"], velocity=[1]), "/joints")

    def test_under_the_name_of_ros(self) -> None:
        state = JointState(header=HEADER, name=["a"], position=[1])
        converter = converter_of("sensor_msgs.JointState", "/ros")
        assert converter.schema_name == "ros.sensor_msgs.JointState"
        seen = defined(converter).FromString(state.SerializeToString())
        assert MessageToDict(seen, preserving_proto_field_name=True) == {
            "header": {"stamp": "1970-01-01T00:00:03.000000004Z", "frame_id": "odom"},
            "name": ["a"],
            "position": [1.0],
        }


class TestDiagnostics:
    NAME = "diagnostic_msgs.DiagnosticArray"
    DEFINITION = definition_of(DiagnosticArray).SerializeToString(deterministic=True)
    STATUS = DiagnosticStatus(
        level=DiagnosticStatus.ERROR, name="motor", values=[KeyValue(key="rpm", value="0")]
    )

    def test_the_topic_itself_goes_by_the_name_of_ros(self) -> None:
        assert converters_for(self.NAME) == ()
        name, definition = as_shown(self.NAME, self.DEFINITION)
        assert name == "ros.diagnostic_msgs.DiagnosticArray"
        message = DiagnosticArray(header=HEADER, status=[self.STATUS])
        seen = class_of(name, definition).FromString(message.SerializeToString())
        (found,) = seen.status  # type: ignore[attr-defined]
        assert (found.level, found.name, found.values[0].key) == (2, "motor", "rpm")
        names = [field.message_type.full_name for field in seen.DESCRIPTOR.fields]
        assert names == ["ros.std_msgs.Header", "ros.diagnostic_msgs.DiagnosticStatus"]

    @pytest.mark.parametrize("name", ["std_msgs.Header", "ros.std_msgs.Header", "rospkg.A", ""])
    def test_other_types_stay_as_they_are(self, name: str) -> None:
        assert as_shown(name, b"x") == (name, b"x")
        assert completion_for(name) is None

    def test_a_definition_that_is_none_stays(self) -> None:
        assert as_shown(self.NAME, b"\x0a\x7f") == (self.NAME, b"\x0a\x7f")

    def test_a_stamp_is_always_there(self) -> None:
        complete = completion_for(self.NAME)
        assert complete is not None
        stamped = DiagnosticArray(header=HEADER, status=[self.STATUS]).SerializeToString()
        assert complete(stamped, CONTEXT.receive_time_ns) is stamped
        bare = DiagnosticArray(header=Header(frame_id="odom"), status=[self.STATUS])
        seen = complete(bare.SerializeToString(), CONTEXT.receive_time_ns)
        bare.header.stamp.CopyFrom(RECEIVED)
        assert DiagnosticArray.FromString(seen) == bare
        with pytest.raises(DecodeError):
            complete(b"\x0a\x7f", 0)

    @pytest.mark.parametrize(
        ("fields", "level", "text"),
        [
            ({"present": False}, "WARN", "no battery"),
            ({"percentage": 0.5}, "OK", "50%"),
            ({"percentage": 0.15}, "WARN", "low, 15%"),
            ({"percentage": 0.05}, "ERROR", "empty, 5%"),
            ({"percentage": math.nan}, "OK", "charge unknown"),
            (
                {
                    "percentage": 0.5,
                    "power_supply_health": BatteryState.POWER_SUPPLY_HEALTH_OVERHEAT,
                },
                "ERROR",
                "overheat, 50%",
            ),
        ],
    )
    def test_battery(self, fields: dict[str, float], level: str, text: str) -> None:
        state = BatteryState(header=HEADER, voltage=12.5, current=math.nan, location="bay 1")
        state.present = bool(fields.pop("present", True))
        state.MergeFrom(BatteryState(**fields))  # type: ignore[arg-type]
        array = shown(state, "/diagnostics", DiagnosticArray)
        (status,) = array.status
        assert (DiagnosticStatus.Level.Name(status.level), status.message) == (level, text)
        assert status.name == "/t: battery bay 1"
        values = {value.key: value.value for value in status.values}
        assert values["voltage"] == "12.5 V"
        assert values["status"] == "unknown"
        assert "current" not in values
        assert array.header.stamp == HEADER.stamp


@pytest.mark.parametrize(
    ("level", "expected"),
    [(0, 0), (1, 1), (2, 2), (4, 3), (8, 4), (16, 5), (9, 4), (3, 2)],
)
def test_log(level: int, expected: int) -> None:
    log = Log(
        header=HEADER,
        level=level,  # type: ignore[arg-type]
        name="driver",
        msg="hot",
        file="a.py",
        line=7,
    )
    line = shown(log, "/log", FoxgloveLog)
    assert (line.level, line.message, line.name) == (expected, "hot", "driver")
    assert (line.file, line.line, line.timestamp) == ("a.py", 7, HEADER.stamp)

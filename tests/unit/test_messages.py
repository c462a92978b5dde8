"""The shipped messages: façades, ROS field names, constants, what an older peer makes of them."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.descriptor import Descriptor

from simple_ros.msg import (
    diagnostic_msgs,
    geometry_msgs,
    nav_msgs,
    rosgraph_msgs,
    sensor_msgs,
    std_msgs,
    tf2_msgs,
    visualization_msgs,
)
from simple_ros.msg.interfaces import ActionType, ServiceType
from simple_ros.msg.registry import shipped_packages

PACKAGES = [
    "action_msgs",
    "builtin_interfaces",
    "diagnostic_msgs",
    "example",
    "example_interfaces",
    "geometry_msgs",
    "link_shaper_msgs",
    "nav_msgs",
    "network_exposure_msgs",
    "rosgraph_msgs",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "tf2_msgs",
    "turtlesim_msgs",
    "ustc",
    "visualization_msgs",
    "wireless_ros_msgs",
]

# Fields in the order of the ROS message, for the types people port code with.
ROS_FIELDS = {
    std_msgs.Header: "seq stamp frame_id",
    std_msgs.MultiArrayDimension: "label size stride",
    geometry_msgs.Twist: "linear angular",
    geometry_msgs.TransformStamped: "header child_frame_id transform",
    geometry_msgs.PoseWithCovarianceStamped: "header pose",
    geometry_msgs.Inertia: "m com ixx ixy ixz iyy iyz izz",
    nav_msgs.Odometry: "header child_frame_id pose twist",
    nav_msgs.MapMetaData: "map_load_time resolution width height origin",
    nav_msgs.OccupancyGrid: "header info data",
    sensor_msgs.Imu: (
        "header orientation orientation_covariance angular_velocity angular_velocity_covariance "
        "linear_acceleration linear_acceleration_covariance"
    ),
    sensor_msgs.JointState: "header name position velocity effort",
    sensor_msgs.Range: "header radiation_type field_of_view min_range max_range range variance",
    sensor_msgs.Illuminance: "header illuminance variance",
    sensor_msgs.LaserScan: (
        "header angle_min angle_max angle_increment time_increment scan_time range_min range_max "
        "ranges intensities"
    ),
    sensor_msgs.PointCloud2: (
        "header height width fields is_bigendian point_step row_step data is_dense"
    ),
    sensor_msgs.Image: "header height width encoding is_bigendian step data",
    sensor_msgs.CameraInfo: (
        "header height width distortion_model d k r p binning_x binning_y roi"
    ),
    sensor_msgs.NavSatFix: (
        "header status latitude longitude altitude position_covariance position_covariance_type"
    ),
    sensor_msgs.BatteryState: (
        "header voltage temperature current charge capacity design_capacity percentage "
        "power_supply_status power_supply_health power_supply_technology present cell_voltage "
        "cell_temperature location serial_number"
    ),
    diagnostic_msgs.DiagnosticStatus: "level name message hardware_id values",
    rosgraph_msgs.Log: "header level name msg file function line topics",
    tf2_msgs.TFMessage: "transforms",
}


def messages_of(package: str) -> list[Descriptor]:
    file = import_module(f"simple_ros.msg.{package}_pb2").DESCRIPTOR
    return list(file.message_types_by_name.values())


ALL_MESSAGES = [message for package in PACKAGES for message in messages_of(package)]


class TestFacades:
    def test_the_shipped_packages_are_those_tested_here(self) -> None:
        shipped = [
            name for name in shipped_packages() if name not in ("simple_ros", "google.protobuf")
        ]
        assert sorted(shipped) == PACKAGES

    @pytest.mark.parametrize("package", PACKAGES)
    def test_exports_all_there_is_and_nothing_else(self, package: str) -> None:
        generated = import_module(f"simple_ros.msg.{package}_pb2")
        facade = import_module(f"simple_ros.msg.{package}")
        file = generated.DESCRIPTOR
        enums = file.enum_types_by_name
        values = {name for enum in enums.values() for name in enum.values_by_name}
        joined = {
            name: value
            for name, value in vars(facade).items()
            if isinstance(value, ServiceType | ActionType)
        }
        assert set(facade.__all__) == {*file.message_types_by_name, *enums, *values, *joined}
        assert len(set(facade.__all__)) == len(facade.__all__)
        for name in set(facade.__all__) - joined.keys():
            assert getattr(facade, name) is getattr(generated, name)
        for name, value in joined.items():
            assert value.name == f"{package}.{name}"

    @pytest.mark.parametrize("package", PACKAGES)
    def test_file_name_is_the_package_name(self, package: str) -> None:
        file = import_module(f"simple_ros.msg.{package}_pb2").DESCRIPTOR
        assert file.package == package
        assert file.name == f"simple_ros/msg/{package}.proto"

    @pytest.mark.parametrize("module", ["simple_ros.msg", "simple_ros.msg.sensor_msgs"])
    def test_messages_need_no_numpy(self, module: str) -> None:
        code = f"import sys, {module}; sys.exit('numpy' in sys.modules)"
        subprocess.run([sys.executable, "-c", code], check=True, timeout=30)


class TestDocumentation:
    TEXT = Path(__file__).resolve().parents[2].joinpath("docs", "messages.md").read_text("utf-8")

    @pytest.mark.parametrize("package", PACKAGES)
    def test_lists_every_type(self, package: str) -> None:
        row = re.search(rf"^\| `{package}` \| (.*) \|$", self.TEXT, re.MULTILINE)
        assert row is not None
        assert row[1].split(", ") == sorted(message.name for message in messages_of(package))

    def test_examples_run(self) -> None:
        blocks = re.findall(r"```python\n(.*?)```", self.TEXT, re.DOTALL)
        assert len(blocks) == 3
        for block in blocks:
            exec(block, {})


class TestRosShape:
    @pytest.mark.parametrize("cls", ROS_FIELDS, ids=lambda cls: cls.DESCRIPTOR.full_name)
    def test_fields_are_those_of_ros_in_their_order(self, cls) -> None:
        fields = cls.DESCRIPTOR.fields
        assert [field.name for field in fields] == ROS_FIELDS[cls].split()
        assert [field.number for field in fields] == list(range(1, len(fields) + 1))

    def test_headers_come_first(self) -> None:
        for message in ALL_MESSAGES:
            header = message.fields_by_name.get("header")
            if header is not None and message.full_name != "visualization_msgs.Marker":
                assert header.message_type is std_msgs.Header.DESCRIPTOR, message.full_name
                assert header.number == 1, message.full_name

    def test_covariances_are_repeated_double(self) -> None:
        fields = [f for m in ALL_MESSAGES for f in m.fields if f.name.endswith("covariance")]
        assert len(fields) == 8
        assert all(field.is_repeated and field.type == field.TYPE_DOUBLE for field in fields)

    def test_eight_bit_arrays_are_bytes(self) -> None:
        classes = (
            std_msgs.ByteMultiArray,
            std_msgs.Int8MultiArray,
            std_msgs.UInt8MultiArray,
            nav_msgs.OccupancyGrid,
            sensor_msgs.Image,
            sensor_msgs.PointCloud2,
        )
        for cls in classes:
            field = cls.DESCRIPTOR.fields_by_name["data"]
            assert field.type == field.TYPE_BYTES

    @pytest.mark.parametrize(
        ("cls", "constants"),
        [
            (sensor_msgs.Range, {"ULTRASOUND": 0, "INFRARED": 1}),
            (sensor_msgs.PointField, {"INT8": 1, "UINT16": 4, "FLOAT32": 7, "FLOAT64": 8}),
            (
                sensor_msgs.NavSatStatus,
                {"STATUS_NO_FIX": -1, "STATUS_FIX": 0, "SERVICE_GALILEO": 8},
            ),
            (sensor_msgs.NavSatFix, {"COVARIANCE_TYPE_UNKNOWN": 0, "COVARIANCE_TYPE_KNOWN": 3}),
            (
                sensor_msgs.BatteryState,
                {"POWER_SUPPLY_STATUS_FULL": 4, "POWER_SUPPLY_HEALTH_COLD": 6},
            ),
            (sensor_msgs.JoyFeedback, {"TYPE_LED": 0, "TYPE_BUZZER": 2}),
            (diagnostic_msgs.DiagnosticStatus, {"OK": 0, "WARN": 1, "ERROR": 2, "STALE": 3}),
            (rosgraph_msgs.Log, {"DEBUG": 1, "INFO": 2, "WARN": 4, "ERROR": 8, "FATAL": 16}),
            (tf2_msgs.TF2Error, {"NO_ERROR": 0, "TRANSFORM_ERROR": 6}),
        ],
        ids=lambda value: None if isinstance(value, dict) else value.DESCRIPTOR.name,
    )
    def test_constants_have_the_numbers_of_ros(self, cls, constants: dict[str, int]) -> None:
        assert {name: getattr(cls, name) for name in constants} == constants

    def test_services_of_a_satellite_receiver_combine(self) -> None:
        both = sensor_msgs.NavSatStatus.SERVICE_GPS | sensor_msgs.NavSatStatus.SERVICE_GALILEO
        assert sensor_msgs.NavSatStatus(service=both).service == 9

    def test_a_number_from_ros_fits_the_flag_of_an_image(self) -> None:
        assert sensor_msgs.Image(is_bigendian=1).SerializeToString() == b"\x28\x01"

    def test_no_fix_survives_the_wire(self) -> None:
        status = sensor_msgs.NavSatStatus(status=sensor_msgs.NavSatStatus.STATUS_NO_FIX)
        parsed = sensor_msgs.NavSatStatus.FromString(status.SerializeToString())
        assert parsed.status == -1


class TestMarkerBetweenVersions:
    """A C++ node knows fields 1 to 13 of Marker; what it does not know it must hand on."""

    @pytest.fixture
    def seed_marker(self):
        file = descriptor_pb2.FileDescriptorProto()
        visualization_msgs.Marker.DESCRIPTOR.file.CopyToProto(file)
        file.dependency[:] = [name for name in file.dependency if "geometry" in name]
        marker = next(message for message in file.message_type if message.name == "Marker")
        for index in reversed(range(len(marker.field))):
            if marker.field[index].number > 13:
                del marker.field[index]
        pool = descriptor_pool.DescriptorPool()
        for cls in (std_msgs.Header, geometry_msgs.Point):
            self._add_with_imports(pool, cls.DESCRIPTOR.file)
        pool.Add(file)
        return message_factory.GetMessageClass(
            pool.FindMessageTypeByName("visualization_msgs.Marker")
        )

    def _add_with_imports(self, pool: descriptor_pool.DescriptorPool, file) -> None:
        for dependency in file.dependencies:
            self._add_with_imports(pool, dependency)
        proto = descriptor_pb2.FileDescriptorProto()
        file.CopyToProto(proto)
        pool.Add(proto)

    def test_new_fields_survive_an_old_node(self, seed_marker) -> None:
        ours = visualization_msgs.Marker(
            ns="a", type=visualization_msgs.LINE_LIST, frame_locked=True
        )
        ours.header.frame_id = "map"
        theirs = seed_marker.FromString(ours.SerializeToString())
        assert theirs.ns == "a"
        assert theirs.type == 20
        assert visualization_msgs.Marker.FromString(theirs.SerializeToString()) == ours

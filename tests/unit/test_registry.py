"""Messages found by name."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import Message
from hypothesis import given, settings
from hypothesis import strategies as st

from simple_ros.errors import SimpleRosError, UnknownMessageType
from simple_ros.msg import example, geometry_msgs
from simple_ros.msg.registry import (
    MsgFactory,
    message_types,
    resolve_type_name,
    shipped_packages,
)


def user_message(
    full_name: str, pool: descriptor_pool.DescriptorPool | None = None
) -> type[Message]:
    """A message class that is not shipped, in a pool of its own unless one is given."""
    package, _, name = full_name.rpartition(".")
    file = descriptor_pb2.FileDescriptorProto(name=f"{full_name}.proto", package=package)
    file.message_type.add(name=name)
    pool = pool or descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(full_name))


@pytest.fixture
def factory() -> MsgFactory:
    return MsgFactory()


class TestCreate:
    def test_instance_is_one_per_process(self) -> None:
        assert MsgFactory.instance() is MsgFactory.instance()

    def test_each_message_is_fresh_and_of_the_generated_class(self, factory: MsgFactory) -> None:
        first = factory.create_message("example.SensorData")
        second = factory.create_message("example.SensorData")
        assert isinstance(first, example.SensorData)
        first.sensor_id = 3
        assert second == example.SensorData()

    @pytest.mark.parametrize(
        "name",
        [
            "SensorData",
            "example/SensorData",
            ".example.SensorData",
            "",
            "example.SensorData\0",
            "example.SensorData\0x",
            "example.SensorData ",
            "example",
            "example.",
            "geometry_msgs.NoSuchThing",
            "no_such_package.Thing",
            "example.SensorData.timestamp",
            "t\u00fcr.Ding",
            "\ud800",
        ],
    )
    def test_only_the_exact_name_counts(self, factory: MsgFactory, name: str) -> None:
        factory.create_message("example.SensorData")
        assert factory.create_message(name) is None
        assert factory.find_class(name) is None

    @settings(derandomize=True, database=None, deadline=None)
    @given(st.text())
    def test_no_text_from_the_network_raises(self, name: str) -> None:
        assert MsgFactory.instance().create_message(name) is None

    def test_shared_message_is_the_message(self, factory: MsgFactory) -> None:
        message = example.Heartbeat()
        assert factory.make_shared_message(message) is message


class TestLazyImport:
    def run(self, code: str) -> list[str]:
        done = subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=30
        )
        return done.stdout.split()

    def test_a_lookup_imports_its_package_and_no_other(self) -> None:
        lines = self.run(
            "import sys; from simple_ros.msg.registry import MsgFactory, shipped_packages\n"
            "shipped_packages()\n"
            "print(sum(name.endswith('_pb2') and 'simple_ros' in name for name in sys.modules))\n"
            "MsgFactory.instance().create_message('ustc.Pose')\n"
            "print(*(name for name in sys.modules if name.endswith('_pb2') and 'simple_ros' in name))"
        )
        assert lines == ["0", "simple_ros.msg.ustc_pb2"]

    def test_control_and_well_known_messages_are_found(self) -> None:
        lines = self.run(
            "from simple_ros.msg.registry import MsgFactory\n"
            "for name in ('simple_ros.NodeInfo', 'google.protobuf.Duration'):\n"
            "    print(MsgFactory.instance().get_class(name).DESCRIPTOR.full_name)"
        )
        assert lines == ["simple_ros.NodeInfo", "google.protobuf.Duration"]

    def test_every_module_in_the_table_holds_its_package(self) -> None:
        for package, modules in shipped_packages().items():
            for module in modules:
                assert sys.modules.get(module) or __import__(module)
                assert sys.modules[module].DESCRIPTOR.package == package


class TestRegister:
    def test_a_registered_class_is_found_and_listed(self, factory: MsgFactory) -> None:
        cls = user_message("my_robot.Arm")
        assert factory.find_class("my_robot.Arm") is None
        assert factory.register_message(cls) is cls
        assert type(factory.create_message("my_robot.Arm")) is cls
        assert "my_robot.Arm" in factory.message_types()

    def test_factories_share_no_registrations(self, factory: MsgFactory) -> None:
        factory.register_message(user_message("my_robot.Leg"))
        assert MsgFactory().find_class("my_robot.Leg") is None

    def test_the_latest_registration_counts(self, factory: MsgFactory) -> None:
        factory.register_message(user_message("my_robot.Hand"))
        latest = factory.register_message(user_message("my_robot.Hand"))
        assert factory.find_class("my_robot.Hand") is latest

    def test_a_registration_wins_over_what_was_found_before(self, factory: MsgFactory) -> None:
        assert factory.find_class("example.Heartbeat") is example.Heartbeat
        other = factory.register_message(user_message("example.Heartbeat"))
        assert factory.find_class("example.Heartbeat") is other

    def test_an_imported_message_is_found_without_registration(self, factory: MsgFactory) -> None:
        name = "registry_test.Imported"
        assert factory.find_class(name) is None
        cls = user_message(name, descriptor_pool.Default())
        assert factory.find_class(name) is cls

    @pytest.mark.parametrize(
        "wrong", [example.SensorData(), "example.SensorData", int, Message, None]
    )
    def test_anything_but_a_generated_class_is_refused(
        self, factory: MsgFactory, wrong: Any
    ) -> None:
        with pytest.raises(TypeError, match="generated message class"):
            factory.register_message(wrong)


class TestGetClass:
    def test_known(self, factory: MsgFactory) -> None:
        assert factory.get_class("geometry_msgs.Twist") is geometry_msgs.Twist

    @pytest.mark.parametrize(
        ("name", "suggestion"),
        [
            ("geometry_msgs/Twist", "geometry_msgs.Twist"),
            ("Twist", "geometry_msgs.Twist"),
            ("geometry_msgs.twist", "geometry_msgs.Twist"),
            ("geometry_msg.Twist", "geometry_msgs.Twist"),
            ("sensor_msgs.LaserScn", "sensor_msgs.LaserScan"),
            ("Pose", "ustc.Pose"),
            ("Strin", "std_msgs.String"),
        ],
    )
    def test_unknown_name_suggests_near_ones(
        self, factory: MsgFactory, name: str, suggestion: str
    ) -> None:
        with pytest.raises(UnknownMessageType, match="did you mean") as caught:
            factory.get_class(name)
        assert caught.value.type_name == name
        assert suggestion in caught.value.suggestions
        assert isinstance(caught.value, LookupError)
        assert isinstance(caught.value, SimpleRosError)

    def test_registered_types_are_suggested_too(self, factory: MsgFactory) -> None:
        factory.register_message(user_message("my_robot.Gripper"))
        with pytest.raises(UnknownMessageType) as caught:
            factory.get_class("my_robot.Griper")
        assert caught.value.suggestions == ("my_robot.Gripper",)

    def test_nothing_near_suggests_nothing(self, factory: MsgFactory) -> None:
        with pytest.raises(UnknownMessageType) as caught:
            factory.get_class("quux")
        assert caught.value.suggestions == ()


class TestMessageTypes:
    def test_sorted_without_control_messages(self) -> None:
        names = message_types()
        assert names == sorted(set(names))
        assert {"example.SensorData", "sensor_msgs.Imu", "ustc.Pose"} <= set(names)
        assert not [name for name in names if name.startswith(("simple_ros.", "google."))]

    def test_each_can_be_made(self, factory: MsgFactory) -> None:
        for name in factory.message_types():
            message = factory.create_message(name)
            assert message is not None
            assert message.DESCRIPTOR.full_name == name


class TestResolve:
    @pytest.mark.parametrize(
        "spelling",
        [
            "geometry_msgs.Twist",
            "geometry_msgs/Twist",
            "geometry_msgs/msg/Twist",
            "geometry_msgs.msg.Twist",
            "geometry_msgs::msg::Twist",
            "/geometry_msgs/Twist",
            ".geometry_msgs.Twist",
            "ros.geometry_msgs.Twist",
            "simple_ros.msg.geometry_msgs.Twist",
            " geometry_msgs/Twist\n",
            "Twist",
        ],
    )
    def test_spellings(self, spelling: str) -> None:
        assert resolve_type_name(spelling) == "geometry_msgs.Twist"

    @pytest.mark.parametrize("full_name", message_types())
    def test_every_ros_spelling_of_every_type(self, full_name: str) -> None:
        package, name = full_name.split(".")
        for spelling in (full_name, f"{package}/{name}", f"{package}/msg/{name}"):
            assert resolve_type_name(spelling) == full_name

    def test_the_name_as_given_comes_first(self, factory: MsgFactory) -> None:
        factory.register_message(user_message("ros.ustc.Pose"))
        assert factory.resolve_type_name("ros.ustc.Pose") == "ros.ustc.Pose"
        assert factory.resolve_type_name("ros/ustc/Pose") == "ustc.Pose"

    def test_two_types_of_one_name_are_both_suggested(self) -> None:
        with pytest.raises(UnknownMessageType) as caught:
            resolve_type_name("Pose")
        assert caught.value.suggestions == (
            "geometry_msgs.Pose",
            "turtlesim_msgs.Pose",
            "ustc.Pose",
        )

    @pytest.mark.parametrize("spelling", ["", "/", "geometry_msgs", "geometry_msgs/Twisted/Twist"])
    def test_nonsense_is_refused(self, spelling: str) -> None:
        with pytest.raises(UnknownMessageType) as caught:
            resolve_type_name(spelling)
        assert caught.value.type_name == spelling

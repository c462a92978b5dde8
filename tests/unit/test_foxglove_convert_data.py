"""Pictures, clouds, scans and grids for Foxglove's panels."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage as FoxgloveCompressedImage
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan as FoxgloveLaserScan
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from simple_ros.foxglove.convert import Context, ConversionFailed, converters_for
from simple_ros.msg.arrays import (
    numpy_to_image,
    numpy_to_occupancy_grid,
    numpy_to_pointcloud2,
    numpy_to_repeated,
)
from simple_ros.msg.geometry_msgs import Point, Pose
from simple_ros.msg.sensor_msgs import (
    CameraInfo,
    CompressedImage,
    Image,
    LaserScan,
    PointCloud2,
    PointField,
)
from simple_ros.msg.std_msgs import Header
from simple_ros.protobuf_wire import split_field, with_field

HEADER = Header(frame_id="sensor", stamp=Timestamp(seconds=3, nanos=4))


def converted(message: Message, topic: str = "/data") -> bytes | None:
    (converter,) = converters_for(message.DESCRIPTOR.full_name)
    return converter.convert(message.SerializeToString(), Context(5, topic))


def shown(message: Message, topic: str = "/data") -> bytes:
    result = converted(message, topic)
    assert result is not None
    return result


class TestWire:
    @settings(deadline=None, derandomize=True)
    @given(st.binary(max_size=300), st.binary(max_size=20), st.integers(0, 2**32 - 1))
    def test_a_field_is_taken_out(self, data: bytes, encoding: bytes, width: int) -> None:
        image = Image(width=width, encoding=encoding.hex(), data=data)
        rest, content = split_field(image.SerializeToString(), 7)
        assert bytes(content) == data
        image.ClearField("data")
        assert Image.FromString(rest) == image

    @settings(deadline=None, derandomize=True)
    @given(st.binary(max_size=300))
    def test_a_field_is_put_in(self, data: bytes) -> None:
        image = Image(width=3, step=9)
        assert Image.FromString(with_field(image, 7, data)) == Image(width=3, step=9, data=data)

    def test_the_last_one_counts(self) -> None:
        twice = Image(data=b"a").SerializeToString() + Image(width=1, data=b"b").SerializeToString()
        rest, content = split_field(twice, 7)
        assert (bytes(content), Image.FromString(rest)) == (b"b", Image(width=1))

    @settings(deadline=None, derandomize=True)
    @given(st.binary(max_size=40))
    def test_garbage_is_an_error_and_nothing_else(self, data: bytes) -> None:
        (converter,) = converters_for("sensor_msgs.Image")
        with contextlib.suppress(ConversionFailed):
            converter.convert(data, Context(0, "/x"))


class TestImage:
    def test_pixels_are_taken_over(self) -> None:
        pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
        image = RawImage.FromString(shown(numpy_to_image(pixels, "rgb8", header=HEADER)))
        assert (image.width, image.height, image.step, image.encoding) == (4, 2, 12, "rgb8")
        assert image.data == pixels.tobytes()
        assert (image.frame_id, image.timestamp) == ("sensor", HEADER.stamp)

    def test_padding_stays(self) -> None:
        image = RawImage.FromString(
            shown(Image(width=2, height=2, step=4, encoding="mono8", data=b"ab__cd__"))
        )
        assert (image.step, image.data) == (4, b"ab__cd__")

    def test_padding_that_is_left_out_is_put_in(self) -> None:
        image = RawImage.FromString(
            shown(Image(width=2, height=2, step=4, encoding="mono8", data=b"ab__cd"))
        )
        assert image.data == b"ab__cd\0\0"

    @pytest.mark.parametrize("data", [b"abc", b"abcde", b""])
    def test_pixels_that_do_not_fit(self, data: bytes) -> None:
        with pytest.raises(ConversionFailed, match=f"{len(data)} bytes"):
            converted(Image(width=2, height=2, encoding="mono8", data=data))

    @pytest.mark.parametrize("encoding", ["mono16", "16UC1", "32FC1"])
    def test_big_endian(self, encoding: str) -> None:
        kind = "f4" if encoding == "32FC1" else "u2"
        pixels = np.array([[1, 2, 300]], dtype=f">{kind}")
        image = RawImage.FromString(shown(numpy_to_image(pixels, encoding)))
        assert image.data == pixels.astype(f"<{kind}").tobytes()
        assert image.encoding == encoding

    @pytest.mark.parametrize(
        ("encoding", "as_shown"),
        [
            ("rgb16", "rgb8"),
            ("bgra16", "bgra8"),
            ("bayer_rggb16", "bayer_rggb8"),
            ("16UC3", "bgr8"),
        ],
    )
    def test_sixteen_bits_become_eight(self, encoding: str, as_shown: str) -> None:
        channels = {"rgb16": 3, "16UC3": 3, "bgra16": 4}.get(encoding, 1)
        pixels = np.array([0x1234] * channels, np.uint16).reshape(1, 1, channels)
        image = RawImage.FromString(shown(numpy_to_image(pixels, encoding)))
        assert (image.encoding, image.data, image.step) == (as_shown, b"\x12" * channels, channels)

    @pytest.mark.parametrize(
        ("encoding", "kind"), [("16SC1", "i2"), ("64FC1", "f8"), ("8SC1", "i1")]
    )
    def test_numbers_become_floats(self, encoding: str, kind: str) -> None:
        pixels = np.array([[-5, 7]], dtype=kind)
        image = RawImage.FromString(shown(numpy_to_image(pixels, encoding)))
        assert image.encoding == "32FC1"
        assert np.frombuffer(image.data, "<f4").tolist() == [-5, 7]

    def test_an_encoding_nobody_knows_is_left_to_the_panel(self) -> None:
        image = RawImage.FromString(
            shown(Image(width=2, height=2, step=3, encoding="nv12", data=b"123456"))
        )
        assert (image.encoding, image.step, image.data) == ("nv12", 3, b"123456")
        assert RawImage.FromString(shown(Image())).data == b""


class TestCompressedImage:
    PNG = b"\x89PNG\r\n\x1a\n" + bytes(20)

    @pytest.mark.parametrize(
        ("words", "data", "name"),
        [
            ("rgb8; jpeg compressed bgr8", b"\xff\xd8\xff\xe0 picture", "jpeg"),
            ("jpeg", PNG, "png"),
            ("", b"RIFF\x01\x02\x03\x04WEBPVP8 ", "webp"),
            ("", b"\0\0\0\x20ftypavif....", "avif"),
            ("JPG", b"no picture", "jpeg"),
            ("png", b"", "png"),
            ("h264", b"\0\0\0\1", "h264"),
        ],
    )
    def test_format(self, words: str, data: bytes, name: str) -> None:
        image = FoxgloveCompressedImage.FromString(
            shown(CompressedImage(header=HEADER, format=words, data=data))
        )
        assert (image.format, image.data, image.frame_id) == (name, data, "sensor")

    def test_depth(self) -> None:
        depth = CompressedImage(format="16UC1; compressedDepth", data=bytes(12) + self.PNG)
        image = FoxgloveCompressedImage.FromString(shown(depth))
        assert (image.format, image.data) == ("png", self.PNG)


def test_camera() -> None:
    info = CameraInfo(
        header=HEADER,
        width=640,
        height=480,
        distortion_model="plumb_bob",
        d=[0.1] * 5,
        k=range(9),
        r=range(9),
        p=range(12),
    )
    camera = CameraCalibration.FromString(shown(info))
    assert (camera.width, camera.height, camera.distortion_model) == (640, 480, "plumb_bob")
    assert (list(camera.K), list(camera.P)) == (list(range(9)), list(range(12)))
    assert len(camera.D) == 5


class TestPointCloud:
    def test_points_are_taken_over(self) -> None:
        kinds = [
            ("x", "<f4"),
            ("y", "<f4"),
            ("z", "<f8"),
            ("ring", "<u2"),
            ("i", "i1"),
            ("n", "<f4", 2),
        ]
        points = np.zeros((2, 3), kinds)
        points["x"] = np.arange(6).reshape(2, 3)
        points["x"][0, 0] = np.nan
        points["n"][..., 1] = 7
        cloud = PointCloud.FromString(shown(numpy_to_pointcloud2(points, header=HEADER)))
        kind = PackedElementField
        assert [(field.name, field.offset, field.type) for field in cloud.fields] == [
            ("x", 0, kind.FLOAT32),
            ("y", 4, kind.FLOAT32),
            ("z", 8, kind.FLOAT64),
            ("ring", 16, kind.UINT16),
            ("i", 18, kind.INT8),
            ("n_0", 19, kind.FLOAT32),
            ("n_1", 23, kind.FLOAT32),
        ]
        assert (cloud.data, cloud.point_stride) == (points.tobytes(), 27)
        assert cloud.frame_id == "sensor"
        assert cloud.pose.orientation.w == 1

    def test_every_datatype(self) -> None:
        names = ["INT8", "UINT8", "INT16", "UINT16", "INT32", "UINT32", "FLOAT32", "FLOAT64"]
        fields = [
            PointField(name=name, offset=8 * place, datatype=PointField.Datatype.Value(name))
            for place, name in enumerate(names)
        ]
        cloud = PointCloud.FromString(
            shown(PointCloud2(height=1, width=1, point_step=64, fields=fields, data=bytes(64)))
        )
        shown_types = [PackedElementField.NumericType.Name(field.type) for field in cloud.fields]
        assert shown_types == names

    @settings(deadline=None, derandomize=True)
    @given(hnp.arrays("<f4", (3, 2, 2), elements=st.floats(-100, 100, width=32)))
    def test_bytes_in_the_other_order(self, values: np.ndarray) -> None:
        points = np.zeros((3, 2), [("x", ">f4"), ("pad", "u1", 3), ("y", ">f4")])
        points["x"], points["y"] = values[..., 0], values[..., 1]
        cloud = PointCloud.FromString(shown(numpy_to_pointcloud2(points)))
        assert cloud.data == points.astype(points.dtype.newbyteorder("<")).tobytes()

    def test_rows_with_padding(self) -> None:
        fields = [PointField(name="x", datatype=PointField.UINT8)]
        cloud = PointCloud2(
            height=2, width=2, point_step=1, row_step=4, fields=fields, data=b"ab__cd__"
        )
        assert PointCloud.FromString(shown(cloud)).data == b"abcd"

    @pytest.mark.parametrize(("name", "alpha"), [("rgb", 255), ("rgba", 0x40)])
    def test_packed_colors(self, name: str, alpha: int) -> None:
        points = np.zeros(2, [("x", "<f4"), (name, "<u4")])
        points[name] = 0x40112233
        cloud = PointCloud.FromString(shown(numpy_to_pointcloud2(points)))
        assert [field.name for field in cloud.fields] == ["x", "blue", "green", "red", "alpha"]
        parts = {field.name: cloud.data[field.offset] for field in cloud.fields[1:]}
        assert parts == {"red": 0x11, "green": 0x22, "blue": 0x33, "alpha": alpha}

    def test_no_points(self) -> None:
        assert PointCloud.FromString(shown(PointCloud2(point_step=4))).data == b""

    @pytest.mark.parametrize(
        "cloud",
        [
            PointCloud2(height=1, width=2, point_step=4, data=bytes(7)),
            PointCloud2(point_step=1, fields=[PointField(name="x", datatype=PointField.FLOAT32)]),
            PointCloud2(
                point_step=300, fields=[PointField(name="x", datatype=PointField.UINT8, count=300)]
            ),
        ],
    )
    def test_what_makes_no_sense(self, cloud: PointCloud2) -> None:
        with pytest.raises(ConversionFailed):
            converted(cloud)


class TestLaserScan:
    def scan(self, ranges: list[float], **fields: float) -> FoxgloveLaserScan:
        scan = LaserScan(header=HEADER, angle_min=-0.5, angle_increment=0.25, **fields)
        numpy_to_repeated(scan, "ranges", np.array(ranges))
        return FoxgloveLaserScan.FromString(shown(scan))

    def test_angles_and_ranges(self) -> None:
        scan = self.scan([1, 2, 3, 4], angle_max=9.0, range_min=0.5, range_max=10)
        assert (scan.start_angle, scan.end_angle) == (-0.5, 0.25)
        assert list(scan.ranges) == [1, 2, 3, 4]
        assert not scan.intensities
        assert scan.frame_id == "sensor"

    def test_without_increment_the_last_angle_is_that_of_the_message(self) -> None:
        scan = LaserScan(angle_min=1, angle_max=2, ranges=[1, 2])
        assert FoxgloveLaserScan.FromString(shown(scan)).end_angle == 2

    def test_no_measurements(self) -> None:
        ranges = self.scan([0.1, 1, 20, math.inf, math.nan], range_min=0.5, range_max=10).ranges
        assert [math.isnan(value) for value in ranges] == [True, False, True, True, True]
        # A scanner that names no limit has none.
        assert list(self.scan([0.1, 1e9]).ranges) == pytest.approx([0.1, 1e9])

    def test_intensities(self) -> None:
        scan = LaserScan(ranges=[1, 2], intensities=[5, 6])
        assert list(FoxgloveLaserScan.FromString(shown(scan)).intensities) == [5, 6]
        scan.intensities.append(7)
        with pytest.raises(ConversionFailed, match="2 ranges but 3 intensities"):
            converted(scan)


class TestGrid:
    CELLS = np.array([[0, 100, -1], [50, 127, -128]], np.int8)

    def grid(self, topic: str) -> tuple[Grid, np.ndarray]:
        origin = Pose(position=Point(x=-1, y=-2))
        message = numpy_to_occupancy_grid(self.CELLS, 0.05, origin=origin, header=HEADER)
        grid = Grid.FromString(shown(message, topic))
        return grid, np.frombuffer(grid.data, np.uint8).reshape(2, 3, 4)

    def test_map(self) -> None:
        grid, pixels = self.grid("/map")
        assert (grid.column_count, grid.row_stride, grid.cell_stride) == (3, 12, 4)
        assert (grid.cell_size.x, grid.cell_size.y) == pytest.approx((0.05, 0.05))
        assert (grid.pose.position.x, grid.pose.position.y) == (-1, -2)
        assert grid.pose.orientation.w == 1
        assert [field.name for field in grid.fields] == ["red", "green", "blue", "alpha"]
        assert [field.offset for field in grid.fields] == [0, 1, 2, 3]
        assert {field.type for field in grid.fields} == {PackedElementField.UINT8}
        free, occupied, unknown = pixels[0].tolist()
        assert (free, occupied, unknown[3]) == ([255, 255, 255, 255], [0, 0, 0, 255], 0)
        half, above, below = pixels[1].tolist()
        assert half == [128, 128, 128, 255]
        assert above[1] > above[0]
        assert below[0] > below[1]

    def test_costs(self) -> None:
        _, pixels = self.grid("/local_costmap/costmap")
        free, lethal, unknown = pixels[0].tolist()
        assert free[3] == 0
        assert lethal[:3] == [255, 0, 255]
        assert 0 < unknown[3] < 255

    def test_size(self) -> None:
        message = numpy_to_occupancy_grid(self.CELLS, 0.05)
        message.info.width = 4
        with pytest.raises(ConversionFailed, match="2 rows of 4 cells has 6 bytes"):
            converted(message)
        message.info.width, message.data = 0, b""
        assert converted(message) is None

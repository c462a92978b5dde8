"""Array fields as numpy arrays and back."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from simple_ros.msg import geometry_msgs, nav_msgs, sensor_msgs, std_msgs
from simple_ros.msg.arrays import (
    covariance_3x3,
    covariance_6x6,
    image_to_numpy,
    image_type,
    laser_scan_angles,
    laser_scan_intensities,
    laser_scan_points,
    laser_scan_ranges,
    multiarray_to_numpy,
    numpy_to_covariance,
    numpy_to_image,
    numpy_to_multiarray,
    numpy_to_occupancy_grid,
    numpy_to_pointcloud2,
    numpy_to_repeated,
    occupancy_grid_to_numpy,
    pointcloud2_dtype,
    pointcloud2_to_numpy,
    pointcloud2_to_points,
    points_to_pointcloud2,
    repeated_to_numpy,
)

PointField = sensor_msgs.PointField

repeatable = settings(
    derandomize=True,
    max_examples=60,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)

ENCODINGS = {
    "mono8": ("uint8", 1),
    "mono16": ("uint16", 1),
    "rgb8": ("uint8", 3),
    "bgr8": ("uint8", 3),
    "rgba8": ("uint8", 4),
    "bgra8": ("uint8", 4),
    "rgb16": ("uint16", 3),
    "bgra16": ("uint16", 4),
    "bayer_rggb8": ("uint8", 1),
    "bayer_grbg16": ("uint16", 1),
    "yuv422": ("uint8", 2),
    "yuyv": ("uint8", 2),
    "8UC1": ("uint8", 1),
    "8UC3": ("uint8", 3),
    "8SC2": ("int8", 2),
    "16UC1": ("uint16", 1),
    "16SC1": ("int16", 1),
    "32SC4": ("int32", 4),
    "32FC1": ("float32", 1),
    "32FC10": ("float32", 10),
    "64FC2": ("float64", 2),
}


def assert_read_only(array: np.ndarray[Any, Any]) -> None:
    with pytest.raises(ValueError, match="read-only"):
        array[...] = array


def same_values(left: np.ndarray[Any, Any], right: np.ndarray[Any, Any]) -> bool:
    """Equal, where NaN equals NaN and the byte order does not matter."""
    return np.array_equal(left, right, equal_nan=left.dtype.kind == "f")


class TestImages:
    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_type_of_an_encoding(self, encoding: str) -> None:
        dtype, channels = image_type(encoding)
        assert (dtype.name, channels) == ENCODINGS[encoding]

    @pytest.mark.parametrize(
        "encoding",
        ["", "RGB8", "rgb", "rgb32", "8UC", "8UC0", "8FC1", "64SC1", "32FC1000", "jpeg", "nv21"],
    )
    def test_unknown_encoding(self, encoding: str) -> None:
        with pytest.raises(ValueError, match="unknown image encoding"):
            image_type(encoding)

    @repeatable
    @given(st.data())
    def test_there_and_back(self, data: st.DataObject) -> None:
        encoding = data.draw(st.sampled_from(list(ENCODINGS)))
        order = data.draw(st.sampled_from("<>"))
        name, channels = ENCODINGS[encoding]
        size = data.draw(st.tuples(st.integers(0, 5), st.integers(0, 5)))
        shape = size if channels == 1 else (*size, channels)
        dtype = np.dtype(name).newbyteorder(order)
        pixels = data.draw(hnp.arrays(dtype, shape))
        image = numpy_to_image(pixels, encoding)
        back = image_to_numpy(sensor_msgs.Image.FromString(image.SerializeToString()))
        assert back.shape == shape
        assert back.dtype == dtype
        assert same_values(back, pixels)

    def test_fields(self) -> None:
        header = std_msgs.Header(frame_id="camera")
        image = numpy_to_image(np.zeros((2, 3, 3), np.uint8), "rgb8", header=header)
        assert image == sensor_msgs.Image(
            header=header, height=2, width=3, encoding="rgb8", step=9, data=bytes(18)
        )

    def test_result_is_a_read_only_view(self) -> None:
        image = numpy_to_image(np.zeros((2, 3), np.uint8), "mono8")
        assert_read_only(image_to_numpy(image))
        assert_read_only(image_to_numpy(sensor_msgs.Image(encoding="mono8", width=4)))
        assert image_to_numpy(image).base is not None

    def test_padding_is_left_out(self) -> None:
        image = sensor_msgs.Image(
            height=2, width=2, encoding="8UC1", step=4, data=b"\x01\x02xx\x03\x04xx"
        )
        assert image_to_numpy(image).tolist() == [[1, 2], [3, 4]]
        image.data = image.data[:-2]
        assert image_to_numpy(image).tolist() == [[1, 2], [3, 4]]

    def test_a_step_that_is_no_multiple_of_the_channel(self) -> None:
        image = sensor_msgs.Image(
            height=2, width=1, encoding="16UC1", step=3, data=b"\x01\x00x\x02\x00x"
        )
        assert image_to_numpy(image).tolist() == [[1], [2]]

    def test_step_zero_counts_as_no_padding(self) -> None:
        image = sensor_msgs.Image(height=2, width=2, encoding="8UC1", data=b"\x01\x02\x03\x04")
        assert image_to_numpy(image).tolist() == [[1, 2], [3, 4]]

    def test_byte_order(self) -> None:
        image = sensor_msgs.Image(height=1, width=1, encoding="mono16", step=2, data=b"\x01\x00")
        assert image_to_numpy(image)[0, 0] == 1
        image.is_bigendian = True
        assert image_to_numpy(image)[0, 0] == 256
        assert numpy_to_image(image_to_numpy(image), "mono16") == image

    def test_arrays_with_strides_and_a_channel_axis(self) -> None:
        pixels = np.arange(24, dtype=np.uint8).reshape(4, 6)
        image = numpy_to_image(pixels[::2, ::-3, np.newaxis], "mono8")
        assert image_to_numpy(image).tolist() == pixels[::2, ::-3].tolist()

    @pytest.mark.parametrize(
        ("image", "reason"),
        [
            (sensor_msgs.Image(height=1, width=2, encoding="rgb8", step=5), "needs 6 bytes"),
            (sensor_msgs.Image(height=2, width=2, encoding="mono8", data=b"123"), "has 3 bytes"),
            (sensor_msgs.Image(height=2, width=2, encoding="mono8", data=b"12345"), "has 5 bytes"),
            (sensor_msgs.Image(encoding="mono8", data=b"1"), "has 1 bytes"),
            (
                sensor_msgs.Image(height=2**32 - 1, width=2**32 - 1, encoding="64FC512"),
                "has 0 bytes",
            ),
            (sensor_msgs.Image(height=1, width=1, data=b"1"), "unknown image encoding ''"),
        ],
    )
    def test_bad_messages(self, image: sensor_msgs.Image, reason: str) -> None:
        with pytest.raises(ValueError, match=reason):
            image_to_numpy(image)

    @pytest.mark.parametrize(
        ("array", "encoding", "reason"),
        [
            (np.zeros((2, 2)), "mono8", r"needs an array of uint8, got float64.*astype\('uint8'\)"),
            (np.zeros((2, 2), np.int8), "mono8", "got int8"),
            (np.zeros((2, 2), np.uint8), "rgb8", r"\(height, width, 3\), got \(2, 2\)"),
            (np.zeros((2, 2, 4), np.uint8), "rgb8", r"got \(2, 2, 4\)"),
            (np.zeros((2, 2, 2), np.uint8), "mono8", r"needs shape \(height, width\)"),
            (np.zeros(4, np.uint8), "mono8", r"got \(4,\)"),
            (np.zeros((1, 1, 1, 1), np.uint8), "mono8", r"got \(1, 1, 1, 1\)"),
        ],
    )
    def test_bad_arrays(self, array: Any, encoding: str, reason: str) -> None:
        with pytest.raises(ValueError, match=reason):
            numpy_to_image(array, encoding)


POINT = np.dtype(
    {
        "names": ["x", "intensity", "normal"],
        "formats": ["f4", "u2", ("f8", 3)],
        "offsets": [0, 6, 8],
        "itemsize": 40,
    }
)


def cloud_of(**changes: Any) -> sensor_msgs.PointCloud2:
    """Two rows of one point with one uint8 `a` and two spare bytes, then `changes`."""
    cloud = sensor_msgs.PointCloud2(
        height=2, width=1, point_step=3, row_step=3, data=b"\x01xx\x02xx"
    )
    cloud.fields.add(name="a", offset=0, datatype=PointField.UINT8, count=1)
    for name, value in changes.items():
        setattr(cloud, name, value)
    return cloud


class TestPointClouds:
    @pytest.mark.parametrize("order", ["<", ">"])
    @pytest.mark.parametrize("shape", [(6,), (2, 3), (0,), (0, 4), (4, 0)])
    def test_there_and_back(self, order: str, shape: tuple[int, ...]) -> None:
        points = np.zeros(shape, POINT.newbyteorder(order))
        points["x"] = np.arange(points.size).reshape(shape)
        points["intensity"] = 300
        points["normal"][..., 2] = 1.5
        cloud = numpy_to_pointcloud2(points)
        back = pointcloud2_to_numpy(sensor_msgs.PointCloud2.FromString(cloud.SerializeToString()))
        assert back.dtype == points.dtype
        assert back.shape == (shape if len(shape) == 2 else (1, *shape))
        for name in POINT.names or ():
            assert same_values(back[name].reshape(points[name].shape), points[name])

    def test_fields(self) -> None:
        cloud = numpy_to_pointcloud2(np.zeros(2, POINT), header=std_msgs.Header(frame_id="lidar"))
        assert list(cloud.fields) == [
            PointField(name="x", offset=0, datatype=PointField.FLOAT32, count=1),
            PointField(name="intensity", offset=6, datatype=PointField.UINT16, count=1),
            PointField(name="normal", offset=8, datatype=PointField.FLOAT64, count=3),
        ]
        assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (1, 2, 40, 80)
        assert cloud.header.frame_id == "lidar"
        assert not cloud.is_bigendian

    @repeatable
    @given(
        st.sampled_from(["i1", "u1", "<i2", ">u2", "<i4", ">u4", "<f4", ">f8"]),
        st.integers(0, 4),
        st.data(),
    )
    def test_plain_columns_there_and_back(self, code: str, rows: int, data: st.DataObject) -> None:
        points = data.draw(hnp.arrays(np.dtype(code), (rows, 3)))
        cloud = points_to_pointcloud2(points)
        back = pointcloud2_to_points(cloud)
        assert back.dtype == np.dtype(code).newbyteorder("=")
        assert same_values(back, points)

    def test_chosen_columns_take_the_type_that_holds_all(self) -> None:
        points = np.zeros(2, POINT)
        points["x"], points["intensity"] = [1.5, 2.5], [7, 8]
        plain = pointcloud2_to_points(numpy_to_pointcloud2(points), ("intensity", "x"))
        assert plain.dtype == np.float32
        assert plain.tolist() == [[7.0, 1.5], [8.0, 2.5]]

    def test_columns_with_strides(self) -> None:
        points = np.arange(12, dtype=np.float32).reshape(3, 4).T[:, ::-1]
        assert same_values(pointcloud2_to_points(points_to_pointcloud2(points)), points)

    def test_dense_is_found_out_unless_told(self) -> None:
        points = np.array([[1.0, 2.0, math.nan]], np.float32)
        assert not points_to_pointcloud2(points).is_dense
        assert points_to_pointcloud2(points, is_dense=True).is_dense
        assert points_to_pointcloud2(np.nan_to_num(points)).is_dense
        assert not numpy_to_pointcloud2(np.zeros(1, POINT), is_dense=False).is_dense

    def test_result_is_a_read_only_view(self) -> None:
        view = pointcloud2_to_numpy(cloud_of())
        assert view["a"].tolist() == [[1], [2]]
        assert view.base is not None
        assert not view["a"].flags.writeable

    def test_padding_after_a_row(self) -> None:
        cloud = cloud_of(row_step=5, data=b"\x01xx..\x02xx..")
        assert pointcloud2_to_numpy(cloud)["a"].tolist() == [[1], [2]]

    def test_row_step_zero_counts_as_no_padding(self) -> None:
        assert pointcloud2_to_numpy(cloud_of(row_step=0))["a"].tolist() == [[1], [2]]

    def test_count_zero_counts_as_one(self) -> None:
        cloud = cloud_of()
        cloud.fields[0].count = 0
        assert pointcloud2_dtype(cloud)["a"] == np.uint8

    def test_a_name_with_a_title_is_one_field(self) -> None:
        titled = np.zeros(1, np.dtype([(("in metres", "x"), "f4")]))
        assert [field.name for field in numpy_to_pointcloud2(titled).fields] == ["x"]

    @pytest.mark.parametrize(
        ("changes", "reason"),
        [
            ({"data": b"12345"}, "has 5 bytes"),
            ({"data": b"1234567"}, "has 7 bytes"),
            ({"row_step": 2}, "a row needs 3 bytes, but its step is 2"),
            ({"width": 2**32 - 1, "height": 2**32 - 1, "row_step": 0}, "has 6 bytes"),
            ({"point_step": 2**31}, "point_step 2147483648 is beyond"),
        ],
    )
    def test_bad_sizes(self, changes: dict[str, Any], reason: str) -> None:
        with pytest.raises(ValueError, match=reason):
            pointcloud2_to_numpy(cloud_of(**changes))

    def test_points_of_no_bytes(self) -> None:
        with pytest.raises(ValueError, match="point_step must not be 0"):
            pointcloud2_to_numpy(sensor_msgs.PointCloud2(height=2**32 - 1, width=2**32 - 1))

    @pytest.mark.parametrize(
        ("field", "reason"),
        [
            (
                PointField(name="b", datatype=PointField.UINT16, offset=2),
                "ends at byte 4 of a point of 3",
            ),
            (
                PointField(name="b", datatype=PointField.INT8, count=2**32 - 1),
                "ends at byte 4294967295",
            ),
            (PointField(name="", datatype=PointField.INT8), "needs a name"),
            (PointField(name="b"), "field 'b' with datatype 0"),
            (PointField(name="b", datatype=9), "field 'b' with datatype 9"),  # type: ignore[arg-type]
            (PointField(name="a", datatype=PointField.INT8), "share a name"),
        ],
    )
    def test_bad_fields(self, field: sensor_msgs.PointField, reason: str) -> None:
        cloud = cloud_of()
        cloud.fields.append(field)
        with pytest.raises(ValueError, match=reason):
            pointcloud2_to_numpy(cloud)

    def test_missing_column(self) -> None:
        with pytest.raises(
            ValueError, match=r"no field 'x' with one element; its fields are \['a'\]"
        ):
            pointcloud2_to_points(cloud_of())
        with pytest.raises(ValueError, match="no field 'normal' with one element"):
            pointcloud2_to_points(numpy_to_pointcloud2(np.zeros(1, POINT)), ("normal",))

    @pytest.mark.parametrize(
        ("points", "reason"),
        [
            (np.zeros((2, 3)), r"points_to_pointcloud2\(\) takes plain arrays"),
            (np.zeros((2, 2, 2), POINT), "of shape"),
            (np.zeros(2, [("t", "i8")]), "field 't' of int64 cannot be a PointField"),
            (np.zeros(2, [("p", [("x", "f4")])]), "field 'p'"),
            (np.zeros(2, [("o", "O")]), "field 'o'"),
            (np.zeros(2, [("x", "<f4"), ("y", ">f4")]), "both byte orders"),
        ],
    )
    def test_bad_structured_arrays(self, points: Any, reason: str) -> None:
        with pytest.raises(ValueError, match=reason):
            numpy_to_pointcloud2(points)

    @pytest.mark.parametrize("points", [np.zeros(3), np.zeros((3, 2)), np.zeros((1, 1, 3))])
    def test_bad_plain_arrays(self, points: Any) -> None:
        with pytest.raises(ValueError, match=r"need an array of shape \(count, 3\)"):
            points_to_pointcloud2(points)

    @repeatable
    @given(
        st.builds(
            sensor_msgs.PointCloud2,
            height=st.integers(0, 3) | st.just(2**32 - 1),
            width=st.integers(0, 3) | st.just(2**32 - 1),
            fields=st.lists(
                st.builds(
                    PointField,
                    name=st.sampled_from(["", "x", "y"]),
                    offset=st.integers(0, 8) | st.just(2**32 - 1),
                    datatype=st.integers(0, 9),
                    count=st.integers(0, 2) | st.just(2**32 - 1),
                ),
                max_size=2,
            ),
            is_bigendian=st.booleans(),
            point_step=st.integers(0, 16) | st.just(2**32 - 1),
            row_step=st.integers(0, 40) | st.just(2**32 - 1),
            data=st.binary(max_size=40),
        )
    )
    def test_whatever_arrives_is_an_array_or_a_value_error(
        self, cloud: sensor_msgs.PointCloud2
    ) -> None:
        try:
            points = pointcloud2_to_numpy(cloud)
        except ValueError:
            return
        assert points.shape == (cloud.height, cloud.width)
        assert len(points.tobytes()) <= len(cloud.data)


class TestScans:
    @pytest.fixture
    def scan(self) -> sensor_msgs.LaserScan:
        return sensor_msgs.LaserScan(
            angle_min=-math.pi / 2,
            angle_increment=math.pi / 2,
            range_min=0.5,
            range_max=10.0,
            ranges=[1.0, 2.0, math.inf],
        )

    def test_ranges_as_sent(self, scan: sensor_msgs.LaserScan) -> None:
        ranges = laser_scan_ranges(scan)
        assert ranges.dtype == np.float32
        assert ranges.tolist() == [1.0, 2.0, math.inf]

    def test_angles(self, scan: sensor_msgs.LaserScan) -> None:
        assert laser_scan_angles(scan) == pytest.approx([-math.pi / 2, 0, math.pi / 2], abs=1e-6)
        assert laser_scan_angles(sensor_msgs.LaserScan()).shape == (0,)

    def test_points_of_valid_beams(self, scan: sensor_msgs.LaserScan) -> None:
        assert laser_scan_points(scan) == pytest.approx(np.array([[0, -1], [2, 0]]), abs=1e-6)
        scan.ranges[:] = [0.4, math.nan, 10.1]
        assert laser_scan_points(scan).shape == (0, 2)

    def test_intensities(self, scan: sensor_msgs.LaserScan) -> None:
        assert laser_scan_intensities(scan).shape == (0,)
        scan.intensities.extend([5, 6, 7])
        assert laser_scan_intensities(scan).tolist() == [5, 6, 7]
        scan.intensities.append(8)
        with pytest.raises(ValueError, match="3 ranges but 4 intensities"):
            laser_scan_intensities(scan)


class TestGrids:
    @repeatable
    @given(hnp.arrays(np.int8, hnp.array_shapes(min_dims=2, max_dims=2, min_side=0, max_side=5)))
    def test_there_and_back(self, cells: np.ndarray[Any, np.dtype[np.int8]]) -> None:
        grid = numpy_to_occupancy_grid(cells, 0.05)
        back = occupancy_grid_to_numpy(nav_msgs.OccupancyGrid.FromString(grid.SerializeToString()))
        assert back.dtype == np.int8
        assert back.shape == cells.shape
        assert same_values(back, cells)
        assert not back.flags.writeable

    def test_fields(self) -> None:
        cells = np.array([[0, 100, -1]])
        grid = numpy_to_occupancy_grid(cells, 0.5, header=std_msgs.Header(frame_id="map"))
        assert (grid.info.width, grid.info.height, grid.info.resolution) == (3, 1, 0.5)
        assert grid.data == b"\x00\x64\xff"
        assert grid.info.origin.orientation.w == 1.0
        assert grid.header.frame_id == "map"

    def test_origin(self) -> None:
        origin = geometry_msgs.Pose(position=geometry_msgs.Point(x=-2.0))
        grid = numpy_to_occupancy_grid(np.zeros((1, 1), int), 1, origin=origin)
        assert grid.info.origin == origin

    def test_bad_message(self) -> None:
        grid = nav_msgs.OccupancyGrid(info=nav_msgs.MapMetaData(width=2, height=2), data=b"123")
        with pytest.raises(ValueError, match="needs 4 bytes of data, has 3"):
            occupancy_grid_to_numpy(grid)

    @pytest.mark.parametrize(
        ("cells", "resolution", "reason"),
        [
            (np.zeros(4, np.int8), 1.0, "shape"),
            (np.zeros((2, 2)), 1.0, "got float64; round them first"),
            (np.array([[0, 255]]), 1.0, r"cells lie in 0\.\.255"),
            (np.zeros((2, 2), np.int8), 0.0, "resolution_m"),
            (np.zeros((2, 2), np.int8), math.nan, "resolution_m"),
            (np.zeros((2, 2), np.int8), math.inf, "resolution_m"),
        ],
    )
    def test_bad_arrays(self, cells: Any, resolution: float, reason: str) -> None:
        with pytest.raises(ValueError, match=reason):
            numpy_to_occupancy_grid(cells, resolution)


MULTI_ARRAYS = {
    "int8": std_msgs.Int8MultiArray,
    "int16": std_msgs.Int16MultiArray,
    "int32": std_msgs.Int32MultiArray,
    "int64": std_msgs.Int64MultiArray,
    "uint8": std_msgs.UInt8MultiArray,
    "uint16": std_msgs.UInt16MultiArray,
    "uint32": std_msgs.UInt32MultiArray,
    "uint64": std_msgs.UInt64MultiArray,
    "float32": std_msgs.Float32MultiArray,
    "float64": std_msgs.Float64MultiArray,
}


def layout_of(*dims: tuple[int, int], offset: int = 0) -> std_msgs.MultiArrayLayout:
    """A layout from (size, stride) of each axis."""
    return std_msgs.MultiArrayLayout(
        dim=[std_msgs.MultiArrayDimension(size=size, stride=stride) for size, stride in dims],
        data_offset=offset,
    )


class TestMultiArrays:
    @repeatable
    @given(st.data())
    def test_there_and_back(self, data: st.DataObject) -> None:
        name = data.draw(st.sampled_from(list(MULTI_ARRAYS)))
        dtype = np.dtype(name).newbyteorder(data.draw(st.sampled_from("<>")))
        shape = data.draw(hnp.array_shapes(min_dims=1, max_dims=4, min_side=0, max_side=4))
        array = data.draw(hnp.arrays(dtype, shape))
        message = numpy_to_multiarray(array)
        assert type(message) is MULTI_ARRAYS[name]
        back = multiarray_to_numpy(type(message).FromString(message.SerializeToString()))
        assert back.dtype == np.dtype(name)
        assert back.shape == shape
        assert same_values(back, array)

    def test_layout_is_that_of_ros(self) -> None:
        message = numpy_to_multiarray(np.zeros((2, 3, 4)), ["plane", "row", "column"])
        assert [(d.label, d.size, d.stride) for d in message.layout.dim] == [
            ("plane", 2, 24),
            ("row", 3, 12),
            ("column", 4, 4),
        ]

    def test_offset_and_strides(self) -> None:
        message = std_msgs.Int32MultiArray(
            data=range(10), layout=layout_of((2, 99), (3, 4), offset=1)
        )
        assert multiarray_to_numpy(message).tolist() == [[1, 2, 3], [5, 6, 7]]

    def test_stride_zero_counts_as_packed(self) -> None:
        message = std_msgs.Int32MultiArray(data=range(6), layout=layout_of((2, 0), (3, 0)))
        assert multiarray_to_numpy(message).tolist() == [[0, 1, 2], [3, 4, 5]]

    def test_no_layout_is_one_axis(self) -> None:
        assert multiarray_to_numpy(std_msgs.Int16MultiArray(data=[1, -2])).tolist() == [1, -2]
        assert multiarray_to_numpy(std_msgs.Float32MultiArray()).shape == (0,)
        offset = std_msgs.Int16MultiArray(data=[1, -2], layout=layout_of(offset=1))
        assert multiarray_to_numpy(offset).tolist() == [-2]

    def test_octets(self) -> None:
        assert multiarray_to_numpy(std_msgs.ByteMultiArray(data=b"\x00\xff")).tolist() == [0, 255]
        assert multiarray_to_numpy(std_msgs.Int8MultiArray(data=b"\x00\xff")).tolist() == [0, -1]

    def test_negative_numbers_are_small_on_the_wire(self) -> None:
        message = std_msgs.Int16MultiArray(data=[-1, -64, 63])
        assert message.SerializeToString() == bytes.fromhex("1203 01 7f 7e")

    @pytest.mark.parametrize(
        ("message", "reason"),
        [
            (std_msgs.Float32MultiArray(layout=layout_of((2, 2))), "needs 2 elements"),
            (
                std_msgs.Float32MultiArray(data=[1, 2], layout=layout_of((2, 2), offset=1)),
                "needs 2 elements",
            ),
            (std_msgs.Float32MultiArray(layout=layout_of(offset=1)), "data_offset 1 is beyond 0"),
            (
                std_msgs.UInt8MultiArray(data=bytes(9), layout=layout_of((5, 5), (5, 1))),
                "needs a stride of 5",
            ),
            (std_msgs.UInt8MultiArray(layout=layout_of((2**32 - 1, 0), (2**32 - 1, 0))), "needs"),
            (std_msgs.Int16MultiArray(data=[40000]), r"Int16MultiArray.data holds -32768\.\.32767"),
            (std_msgs.Float32(), r"std_msgs\.Float32 is no MultiArray"),
            (std_msgs.UInt16MultiArray(data=[70000]), r"got 70000\.\.70000"),
        ],
    )
    def test_bad_messages(self, message: Any, reason: str) -> None:
        with pytest.raises(ValueError, match=reason):
            multiarray_to_numpy(message)

    @repeatable
    @given(
        st.lists(
            st.tuples(
                st.integers(0, 4) | st.just(2**32 - 1), st.integers(0, 20) | st.just(2**32 - 1)
            ),
            max_size=4,
        ),
        st.integers(0, 5),
        st.binary(max_size=30),
    )
    def test_whatever_arrives_is_an_array_or_a_value_error(
        self, dims: list[tuple[int, int]], offset: int, data: bytes
    ) -> None:
        message = std_msgs.UInt8MultiArray(data=data, layout=layout_of(*dims, offset=offset))
        try:
            array = multiarray_to_numpy(message)
        except ValueError:
            return
        assert array.size <= len(data)
        assert set(array.ravel().tolist()) <= set(data)

    def test_number_of_axes_has_a_limit(self) -> None:
        message = std_msgs.UInt8MultiArray(data=b"1", layout=layout_of(*[(1, 1)] * 32))
        assert multiarray_to_numpy(message).ndim == 32
        message.layout.dim.add(size=1, stride=1)
        with pytest.raises(ValueError, match="more than 32 axes"):
            multiarray_to_numpy(message)

    @pytest.mark.parametrize(
        "array", [np.zeros(2, bool), np.zeros(2, complex), np.zeros(2, np.float16), np.float64(1)]
    )
    def test_arrays_without_a_message(self, array: Any) -> None:
        with pytest.raises(ValueError, match="no MultiArray holds"):
            numpy_to_multiarray(array)

    def test_labels_must_fit(self) -> None:
        with pytest.raises(ValueError, match="1 labels for an array of 2 axes"):
            numpy_to_multiarray(np.zeros((2, 2)), ["row"])


class TestCovariances:
    def test_6x6(self) -> None:
        odometry = nav_msgs.Odometry()
        matrix = np.arange(36.0).reshape(6, 6)
        odometry.pose.covariance[:] = numpy_to_covariance(matrix)
        assert same_values(covariance_6x6(odometry.pose.covariance), matrix)

    def test_3x3_from_any_numbers(self) -> None:
        imu = sensor_msgs.Imu(orientation_covariance=numpy_to_covariance(np.eye(3, dtype=int).T))
        assert same_values(covariance_3x3(imu.orientation_covariance), np.eye(3))

    def test_never_set_is_zero_and_one_s_own(self) -> None:
        imu = sensor_msgs.Imu()
        matrix = covariance_3x3(imu.orientation_covariance)
        assert same_values(matrix, np.zeros((3, 3)))
        matrix[0, 0] = 1.0
        assert not imu.orientation_covariance

    def test_wrong_sizes(self) -> None:
        with pytest.raises(ValueError, match=r"a 3x3 covariance has 9 values.*this field has 36"):
            covariance_3x3([0.0] * 36)
        with pytest.raises(ValueError, match="a 6x6 covariance has 36 values"):
            covariance_6x6([0.0] * 9)
        for shape in [(9,), (4, 4), (3, 6), ()]:
            with pytest.raises(ValueError, match="a covariance has shape"):
                numpy_to_covariance(np.zeros(shape))


class TestRepeated:
    @pytest.mark.parametrize("count", [0, 1, 127, 128, 129, 5000])
    @pytest.mark.parametrize(
        ("message", "field", "dtype"),
        [
            (sensor_msgs.LaserScan(angle_min=1, intensities=[1]), "ranges", np.float32),
            (sensor_msgs.JointState(name=["a" * 300, "b"], position=[1]), "velocity", np.float64),
            (std_msgs.Int32MultiArray(), "data", np.int32),
            (std_msgs.UInt64MultiArray(), "data", np.uint64),
            (sensor_msgs.Joy(axes=[1.0]), "buttons", np.int32),
        ],
        ids=["float", "double", "sint32", "uint64", "int32"],
    )
    def test_there_and_back_leaves_the_rest_alone(
        self, message: Any, field: str, dtype: Any, count: int
    ) -> None:
        before = type(message)()
        before.CopyFrom(message)
        array = np.arange(count, dtype=dtype)
        numpy_to_repeated(before, field, array)
        result = repeated_to_numpy(before, field)
        assert result.dtype == dtype
        assert same_values(result, array)
        assert list(getattr(before, field)) == array.tolist()
        before.ClearField(field)
        assert before == message

    def test_values_are_replaced_and_not_added(self) -> None:
        scan = sensor_msgs.LaserScan(ranges=[9.0] * 200)
        numpy_to_repeated(scan, "ranges", np.array([1.0, 2.0]))
        assert list(scan.ranges) == [1.0, 2.0]

    def test_unknown_fields_before_and_after_do_not_disturb(self) -> None:
        known = std_msgs.Float32MultiArray(data=np.arange(200))
        known.layout.data_offset = 3
        strange = bytes.fromhex("a106 0000000000000000 ad06 00000000 b006 05 bb06 bc06")
        message = std_msgs.Float32MultiArray.FromString(
            strange + known.SerializeToString() + strange
        )
        assert repeated_to_numpy(message, "data").tolist() == list(range(200))

    def test_floats_lose_precision_but_keep_their_size(self) -> None:
        scan = sensor_msgs.LaserScan()
        numpy_to_repeated(scan, "ranges", np.array([0.1, 1e300, -math.inf], ">f8"))
        assert scan.ranges[0] == pytest.approx(0.1, rel=1e-7)
        assert list(scan.ranges[1:]) == [math.inf, -math.inf]

    def test_integers_into_floats(self) -> None:
        scan = sensor_msgs.LaserScan()
        numpy_to_repeated(scan, "ranges", np.arange(3))
        assert list(scan.ranges) == [0.0, 1.0, 2.0]

    @pytest.mark.parametrize(
        ("message", "field", "array", "reason"),
        [
            (
                std_msgs.UInt32MultiArray(data=[7]),
                "data",
                np.array([-1]),
                r"holds 0\.\.4294967295, got -1",
            ),
            (sensor_msgs.Joy(buttons=[7]), "buttons", np.array([2**31]), "got 2147483648"),
            (
                sensor_msgs.Joy(buttons=[7]),
                "buttons",
                np.array([0.5]),
                "needs an array of int32, got float64",
            ),
            (sensor_msgs.Joy(buttons=[7]), "buttons", np.array([True]), "got bool"),
            (sensor_msgs.Joy(axes=[7]), "axes", np.array([1j]), "needs an array of float32"),
            (sensor_msgs.Joy(axes=[7]), "axes", np.array(["a"]), "needs an array of float32"),
            (
                sensor_msgs.Joy(axes=[7]),
                "axes",
                np.zeros((1, 1)),
                r"shape \(count,\), got \(1, 1\)",
            ),
            (
                sensor_msgs.Joy(axes=[7]),
                "axis",
                np.zeros(1),
                "Joy has no repeated number field 'axis'",
            ),
            (sensor_msgs.Joy(axes=[7]), "header", np.zeros(1), "no repeated number field 'header'"),
            (
                sensor_msgs.JointState(name=["j"]),
                "name",
                np.zeros(1),
                "no repeated number field 'name'",
            ),
            (std_msgs.Float32(data=7), "data", np.zeros(1), "no repeated number field 'data'"),
        ],
    )
    def test_what_does_not_fit_changes_nothing(
        self, message: Any, field: str, array: Any, reason: str
    ) -> None:
        before = message.SerializeToString()
        with pytest.raises(ValueError, match=reason):
            numpy_to_repeated(message, field, array)
        assert message.SerializeToString() == before
        if reason.startswith(("no repeated", "Joy has no")):
            with pytest.raises(ValueError, match=reason):
                repeated_to_numpy(message, field)

"""Pictures and cameras."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage as FoxgloveCompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from simple_ros.foxglove.convert.base import Context, Converter, described
from simple_ros.foxglove.convert.common import frame_of, stamp_of
from simple_ros.msg.arrays import image_to_numpy, image_type
from simple_ros.msg.sensor_msgs import CameraInfo, CompressedImage, Image
from simple_ros.protobuf_wire import split_field, with_field

__all__ = ["CompressedImageConverter", "ImageConverter", "calibration"]

_ROS_DATA = Image.DESCRIPTOR.fields_by_name["data"].number
_ROS_COMPRESSED = CompressedImage.DESCRIPTOR.fields_by_name["data"].number
_DATA = RawImage.DESCRIPTOR.fields_by_name["data"].number
_COMPRESSED = FoxgloveCompressedImage.DESCRIPTOR.fields_by_name["data"].number

_HIGH_BYTE = {
    **{f"{name}16": f"{name}8" for name in ("rgb", "bgr", "rgba", "bgra")},
    **{f"bayer_{name}16": f"bayer_{name}8" for name in ("rggb", "bggr", "gbrg", "grbg")},
    "16UC3": "bgr8",
    "16UC4": "bgra8",
}
"""What panels do not know with 16 bits and show just as well with 8."""
_AS_FLOAT = frozenset({"8SC1", "16SC1", "32SC1", "64FC1"})
"""What panels do not know and show as 32FC1."""
_RENAMED = {"8UC4": "bgra8"}

_PNG = b"\x89PNG\r\n\x1a\n"
_DEPTH_HEADER_BYTES = 12


class ImageConverter(Converter):
    """``sensor_msgs.Image`` as ``foxglove.RawImage``.

    The pixels are taken over as they lie, but for encodings that panels do not know, and numbers with
    the most significant byte first.
    """

    schema_name = RawImage.DESCRIPTOR.full_name
    suffix = "/image"

    @property
    def schema(self) -> bytes:
        """See `Converter`."""
        return described(RawImage)

    def _converted(self, message: bytes, context: Context) -> bytes:
        data: bytes | memoryview
        rest, data = split_field(message, _ROS_DATA)
        image = Image.FromString(rest)
        result = RawImage(
            timestamp=stamp_of(image.header, context),
            frame_id=frame_of(image.header, context),
            width=image.width,
            height=image.height,
            encoding=_RENAMED.get(image.encoding, image.encoding),
        )
        if _must_change(image):
            image.data = bytes(data)
            data, result.encoding = _changed(image)
            result.step = len(data) // image.height if image.height else 0
        else:
            result.step = image.step or _row_bytes(image)
            data = _whole(data, image.height, result.step, _row_bytes(image))
        return with_field(result, _DATA, data)


def _must_change(image: Image) -> bool:
    if image.encoding in _HIGH_BYTE or image.encoding in _AS_FLOAT:
        return True
    return image.is_bigendian and _is_known(image.encoding) and _is_wide(image.encoding)


def _is_wide(encoding: str) -> bool:
    return image_type(encoding)[0].itemsize > 1


def _is_known(encoding: str) -> bool:
    try:
        image_type(encoding)
    except ValueError:
        return False
    return True


def _row_bytes(image: Image) -> int:
    """The bytes of a row without padding; 0 if the encoding is unknown: the panel will say so."""
    if not _is_known(image.encoding):
        return 0
    dtype, channels = image_type(image.encoding)
    return image.width * channels * dtype.itemsize


def _changed(image: Image) -> tuple[memoryview, str]:
    """The pixels as panels know them, and their encoding."""
    pixels, encoding = image_to_numpy(image), image.encoding
    if encoding in _AS_FLOAT:
        pixels, encoding = pixels.astype("<f4"), "32FC1"
    elif encoding in _HIGH_BYTE:
        pixels, encoding = (pixels >> 8).astype(np.uint8), _HIGH_BYTE[encoding]
    else:
        pixels = pixels.astype(pixels.dtype.newbyteorder("<"))
    return np.ascontiguousarray(pixels).reshape(-1).view(np.uint8).data, encoding


def _whole(data: memoryview, height: int, step: int, row: int) -> bytes | memoryview:
    """As many bytes as rows and step say; some senders leave out the padding of the last row.

    Raises:
        ValueError: Pixels are missing, or there are more.
    """
    missing = step * height - len(data)
    if missing == 0 or not row:
        return data
    if not 0 < missing <= step - row:
        raise ValueError(f"an image of {height} rows of {step} bytes has {len(data)} bytes of data")
    return bytes(data) + bytes(missing)


class CompressedImageConverter(Converter):
    """``sensor_msgs.CompressedImage`` as ``foxglove.CompressedImage``.

    ROS describes the format in words (``"bgr8; jpeg compressed bgr8"``), panels want ``jpeg``. The
    picture itself knows best.
    """

    schema_name = FoxgloveCompressedImage.DESCRIPTOR.full_name
    suffix = "/image"

    @property
    def schema(self) -> bytes:
        """See `Converter`."""
        return described(FoxgloveCompressedImage)

    def _converted(self, message: bytes, context: Context) -> bytes:
        rest, data = split_field(message, _ROS_COMPRESSED)
        image = CompressedImage.FromString(rest)
        if data[_DEPTH_HEADER_BYTES : _DEPTH_HEADER_BYTES + len(_PNG)] == _PNG:
            # compressed_depth_image_transport writes how it scaled the depth before the picture.
            data = data[_DEPTH_HEADER_BYTES:]
        result = FoxgloveCompressedImage(
            timestamp=stamp_of(image.header, context),
            frame_id=frame_of(image.header, context),
            format=_format_of(data) or _format_in_words(image.format),
        )
        return with_field(result, _COMPRESSED, data)


def _format_of(data: memoryview) -> str:
    """What the first bytes of a picture tell; empty if nothing."""
    head = bytes(data[:12])
    if head.startswith(b"\xff\xd8\xff"):
        return "jpeg"
    if head.startswith(_PNG):
        return "png"
    if head.startswith(b"RIFF") and head.endswith(b"WEBP"):
        return "webp"
    return "avif" if head[4:] in (b"ftypavif", b"ftypavis") else ""


def _format_in_words(words: str) -> str:
    lower = words.lower()
    if "jpg" in lower or "jpeg" in lower:
        return "jpeg"
    return next((name for name in ("png", "webp", "avif") if name in lower), words)


def calibration(message: CameraInfo, context: Context) -> CameraCalibration:
    """How a camera maps space to pixels."""
    return CameraCalibration(
        timestamp=stamp_of(message.header, context),
        frame_id=frame_of(message.header, context),
        width=message.width,
        height=message.height,
        distortion_model=message.distortion_model,
        D=message.d,
        K=message.k,
        R=message.r,
        P=message.p,
    )

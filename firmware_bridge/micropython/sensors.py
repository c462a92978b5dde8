"""Chips on the I2C bus, without the bus: each takes an object with `readfrom_mem_into` and `writeto_mem`.

Register numbers and values are those of InvenSense's MPU-6000/MPU-6050 register map (RM-MPU-6000A) and ST's
VL6180X data sheet with its application note AN4545.
"""

import math
from struct import unpack_from

import micropython

_MPU_NAMES = {0x68: "MPU6050", 0x70: "MPU6500", 0x71: "MPU9250", 0x73: "MPU9255", 0x98: "ICM-20689"}
_RAD_S = 500 / 32768 * math.pi / 180
_M_S2 = 4 * 9.80665 / 32768
_REST_SAMPLES = 100
_REST_SPREAD = 100  # 1.5 degrees/s
_REST_LIMIT = 660  # 10 degrees/s: more is a hand that turns it


class Mpu6050:
    """Turn rates and accelerations, at 500 degrees/s and 4 g at most.

    Args:
        bus: The I2C bus.
        axes: Which axis of the chip points forward, left, up, and its sign.
        address: Of the chip: 0x68, or 0x69 with AD0 high.

    Raises:
        OSError: It does not answer.
    """

    def __init__(self, bus, axes, address=0x68):
        self._bus = bus
        self._axes = axes
        self._address = address
        self._raw = bytearray(14)
        one = bytearray(1)
        bus.readfrom_mem_into(address, 0x75, one)
        self.name = _MPU_NAMES.get(one[0], f"MPU of unknown kind {one[0]:#x}")
        # Awake on the gyroscope's clock; 44 Hz filter; 200 samples/s; 500 degrees/s; 4 g.
        for register, value in ((0x6B, 1), (0x1A, 3), (0x19, 4), (0x1B, 0x08), (0x1C, 0x08)):
            bus.writeto_mem(address, register, bytes((value,)))
        self._rest = [0.0, 0.0, 0.0]
        self._sums = [0, 0, 0]
        self._lows = [0, 0, 0]
        self._highs = [0, 0, 0]
        self._count = 0

    @micropython.native
    def read(self, values, is_still):
        """Turn rates x y z (rad/s) and accelerations x y z (m/s^2), into an array of six.

        Args:
            values: The array.
            is_still: Whether no motor has power: then the gyroscope's error can be learnt.
        """
        self._bus.readfrom_mem_into(self._address, 0x3B, self._raw)
        raw = unpack_from(">7h", self._raw)
        if is_still:
            self._learn_rest(raw)
        else:
            self._count = 0
        rest, axes = self._rest, self._axes
        for i in range(3):
            axis, sign = axes[i]
            values[i] = sign * (raw[4 + axis] - rest[axis]) * _RAD_S
            values[3 + i] = sign * raw[axis] * _M_S2

    def _learn_rest(self, raw):
        """What the gyroscope says while nothing moves is its error: learnt whenever that is so."""
        if self._count == 0:
            self._sums, self._lows, self._highs = [0, 0, 0], list(raw[4:]), list(raw[4:])
        self._count += 1
        for i in range(3):
            value = raw[4 + i]
            self._sums[i] += value
            self._lows[i] = min(self._lows[i], value)
            self._highs[i] = max(self._highs[i], value)
        if self._count < _REST_SAMPLES:
            return
        spread = max([self._highs[i] - self._lows[i] for i in range(3)])
        means = [total / self._count for total in self._sums]
        if spread < _REST_SPREAD and max([abs(mean) for mean in means]) < _REST_LIMIT:
            self._rest = means
        self._count = 0


class Vl6180x:
    """Distance and light, one after the other, without waiting for either.

    Args:
        bus: The I2C bus.
        address: Of the chip.

    Raises:
        OSError: It does not answer, or is another chip.
    """

    _PRIVATE = (
        b"\x02\x07\x01\x02\x08\x01\x00\x96\x00\x00\x97\xfd\x00\xe3\x00\x00\xe4\x04\x00\xe5\x02\x00\xe6\x01"
        b"\x00\xe7\x03\x00\xf5\x02\x00\xd9\x05\x00\xdb\xce\x00\xdc\x03\x00\xdd\xf8\x00\x9f\x00\x00\xa3\x3c"
        b"\x00\xb7\x00\x00\xbb\x3c\x00\xb2\x09\x00\xca\x09\x01\x98\x01\x01\xb0\x17\x01\xad\x00\x00\xff\x05"
        b"\x01\x00\x05\x01\x99\x05\x01\xa6\x1b\x01\xac\x3e\x01\xa7\x1f\x00\x30\x00"
    )
    # Polling of new samples, averaging, gain 1 for light, recalibration, 100 ms of light, 30 ms for a distance.
    _PUBLIC = (
        (0x0011, 0x10),
        (0x010A, 0x30),
        (0x003F, 0x46),
        (0x0031, 0xFF),
        (0x0040, 0x00),
        (0x0041, 0x63),
        (0x002E, 0x01),
        (0x001C, 0x1E),
        (0x0014, 0x24),
    )
    _LUX_PER_COUNT = 0.32

    def __init__(self, bus, address=0x29):
        self._bus = bus
        self._address = address
        self._one = bytearray(1)
        self._two = bytearray(2)
        if self._read(0x0000) != 0xB4:
            raise OSError(f"the chip at {address:#x} is no VL6180X")
        if self._read(0x0016) & 1:
            private = self._PRIVATE
            for i in range(0, len(private), 3):
                self._write(private[i] << 8 | private[i + 1], private[i + 2])
            self._write(0x0016, 0)
        for register, value in self._PUBLIC:
            self._write(register, value)
        self._distance = self._light = None
        self._is_ranging = True
        self._begin()

    def _read(self, register):
        self._bus.readfrom_mem_into(self._address, register, self._one, addrsize=16)
        return self._one[0]

    def _write(self, register, value):
        self._one[0] = value
        self._bus.writeto_mem(self._address, register, self._one, addrsize=16)

    def _begin(self):
        self._write(0x0015, 0x07)
        self._write(0x0018 if self._is_ranging else 0x0038, 0x01)

    def poll(self):
        """Look whether it is ready, take what it has, and begin the next; a millisecond at most."""
        status = self._read(0x004F)
        if self._is_ranging:
            if status & 7 == 4:
                # An error, such as nothing in view, is in the upper bits.
                is_good = self._read(0x004D) >> 4 == 0
                self._distance = self._read(0x0062) / 1000 if is_good else math.inf
                self._is_ranging = False
                self._begin()
        elif status >> 3 & 7 == 4:
            self._bus.readfrom_mem_into(self._address, 0x0050, self._two, addrsize=16)
            self._light = (self._two[0] << 8 | self._two[1]) * self._LUX_PER_COUNT
            self._is_ranging = True
            self._begin()

    def take_distance(self):
        """Metres, infinity if nothing is in view; None if nothing new was measured."""
        distance, self._distance = self._distance, None
        return distance

    def take_light(self):
        """Lux; None if nothing new was measured."""
        light, self._light = self._light, None
        return light

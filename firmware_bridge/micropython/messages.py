"""ROS 2 messages as plain CDR, little endian, each made once and filled in again for every sample.

What never changes (names, frames, covariances) is written at the start; `fill` puts the numbers in, at
positions that were noted then.
"""

from struct import pack, pack_into, unpack_from

_INFRARED, _ULTRASOUND = 1, 0


class Layout:
    """Writes fields one after the other, each at a multiple of its size, and says where it put them.

    Attributes:
        data: What was written.
    """

    def __init__(self):
        self.data = b""

    def put(self, code, *values):
        """Numbers of one `struct` code; gives the position of the first."""
        size = 8 if code == "d" else 1 if code == "B" else 4
        self.data += bytes(-len(self.data) % size)
        at = len(self.data)
        self.data += pack(f"<{len(values)}{code}", *values)
        return at

    def text(self, text):
        """A string."""
        self.put("I", len(text) + 1)
        self.data += text.encode() + b"\0"

    def header(self, frame):
        """std_msgs/Header; the stamp is at position 0."""
        self.put("I", 0, 0)
        self.text(frame)


def diagonal(size, values):
    """A square matrix, row by row, with ``values`` on its diagonal and zeros elsewhere."""
    matrix = [0.0] * (size * size)
    for i, value in enumerate(values):
        matrix[i * (size + 1)] = value
    return matrix


class Stamped:
    """A message with a header.

    Attributes:
        data: The sample.
    """

    def __init__(self, layout):
        self.data = bytearray(layout.data)

    def stamp(self, clock):
        """Set its time."""
        pack_into("<II", self.data, 0, clock.stamp_s(), clock.stamp_ns())


class JointState(Stamped):
    """sensor_msgs/JointState of joints with position (rad) and velocity (rad/s)."""

    TYPE = "sensor_msgs/JointState"

    def __init__(self, names):
        layout = Layout()
        layout.header("")
        layout.put("I", len(names))
        for name in names:
            layout.text(name)
        zeros = [0.0] * len(names)
        self._numbers = f"<{len(names)}d"
        layout.put("I", len(names))
        self._position = layout.put("d", *zeros)
        layout.put("I", len(names))
        self._velocity = layout.put("d", *zeros)
        layout.put("I", 0)
        super().__init__(layout)

    def fill(self, positions, velocities):
        """Set its numbers, one for each joint."""
        pack_into(self._numbers, self.data, self._position, *positions)
        pack_into(self._numbers, self.data, self._velocity, *velocities)


class Imu(Stamped):
    """sensor_msgs/Imu that measures no orientation, as the -1 in its covariance says."""

    TYPE = "sensor_msgs/Imu"

    def __init__(self, frame, gyro_variance, accel_variance):
        layout = Layout()
        layout.header(frame)
        layout.put("d", 0.0, 0.0, 0.0, 1.0)
        layout.put("d", -1.0, *[0.0] * 8)
        self._gyro = layout.put("d", 0.0, 0.0, 0.0)
        layout.put("d", *diagonal(3, [gyro_variance] * 3))
        self._accel = layout.put("d", 0.0, 0.0, 0.0)
        layout.put("d", *diagonal(3, [accel_variance] * 3))
        super().__init__(layout)

    def fill(self, values):
        """Set its numbers: angular velocity x y z (rad/s), then acceleration x y z (m/s^2)."""
        pack_into("<ddd", self.data, self._gyro, values[0], values[1], values[2])
        pack_into("<ddd", self.data, self._accel, values[3], values[4], values[5])


class Odometry(Stamped):
    """nav_msgs/Odometry of a robot on a floor."""

    TYPE = "nav_msgs/Odometry"

    def __init__(self, frame, child_frame, pose_variances, twist_variances):
        layout = Layout()
        layout.header(frame)
        layout.text(child_frame)
        self._pose = layout.put("d", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
        layout.put("d", *diagonal(6, pose_variances))
        self._twist = layout.put("d", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        layout.put("d", *diagonal(6, twist_variances))
        super().__init__(layout)

    def fill_pose(self, x, y, sin_half, cos_half):
        """Set where it is: m, m, sine and cosine of half its yaw."""
        pack_into("<dd", self.data, self._pose, x, y)
        pack_into("<dd", self.data, self._pose + 40, sin_half, cos_half)

    def fill_twist(self, vx, vy, wz):
        """Set how it moves: m/s forward, m/s to the left, rad/s counter-clockwise."""
        pack_into("<dd", self.data, self._twist, vx, vy)
        pack_into("<d", self.data, self._twist + 40, wz)


class Range(Stamped):
    """sensor_msgs/Range, with the ``variance`` of Iron and later.

    Args:
        frame: Of the sensor.
        is_infrared: Else it is ultrasound.
        view_rad: Angle of what it sees.
        least_m: Shortest distance it measures.
        most_m: Longest distance it measures.
    """

    TYPE = "sensor_msgs/Range"

    def __init__(self, frame, is_infrared, view_rad, least_m, most_m):
        layout = Layout()
        layout.header(frame)
        layout.put("B", _INFRARED if is_infrared else _ULTRASOUND)
        layout.put("f", view_rad, least_m, most_m)
        self._range = layout.put("f", 0.0, 0.0)
        super().__init__(layout)

    def fill(self, distance_m):
        """Set the distance; infinity means that nothing is in view."""
        pack_into("<f", self.data, self._range, distance_m)


class Illuminance(Stamped):
    """sensor_msgs/Illuminance."""

    TYPE = "sensor_msgs/Illuminance"

    def __init__(self, frame):
        layout = Layout()
        layout.header(frame)
        self._lux = layout.put("d", 0.0, 0.0)
        super().__init__(layout)

    def fill(self, lux):
        """Set the light."""
        pack_into("<d", self.data, self._lux, lux)


class Twist:
    """geometry_msgs/Twist, read in place: m/s forward and to the left, rad/s counter-clockwise."""

    TYPE = "geometry_msgs/Twist"
    SIZE = 48

    @staticmethod
    def read(data, at):
        """``vx, vy, wz`` of the sample at a position."""
        return unpack_from("<dd24xd", data, at)

"""A SIMULATED robot for MicroPython on a computer: the interface of `hardware.Hardware`, and no hardware.

Four motors that follow their power as a first-order lag, encoders that count, a square room of 4 m.
"""

import math
import time

from port import StdioPort

_MOTOR_S = 0.05
_STRENGTH = 0.9
_WALL_M = 2.0
_GRAVITY = 9.80665


def open_line(config):  # noqa: ARG001
    """The line is stdin and stdout, as over USB."""
    return StdioPort()


class Hardware:
    """A robot that does not exist.

    Args:
        config: The module of that name.
        say: Called with text for a person.
    """

    NAME = "SIMULATED robot"

    def __init__(self, config, say):  # noqa: ARG002
        self._config = config
        self._speeds = [0.0] * 4
        self._angles = [0.0] * 4
        self._duties = [0.0] * 4
        self._stepped_ms = 0
        self._noise = 1
        self.x = self.y = self.yaw = 0.0
        self.vx = self.vy = self.wz = 0.0
        self.is_lit = False

    def identity(self):
        """Bytes that are this board's own."""
        return b"simulated"

    def pause(self):
        """Let others work."""
        time.sleep_ms(1)

    def update(self, now):
        """Let time pass, in steps of at most 10 ms."""
        while self._stepped_ms < now:
            step = min(10, now - self._stepped_ms)
            self._stepped_ms += step
            self._step(step / 1000)

    def _step(self, dt):
        config = self._config
        speeds = self._speeds
        for i in range(4):
            end = self._duties[i] * config.MAX_WHEEL_RAD_S * _STRENGTH
            speeds[i] += (end - speeds[i]) * min(1.0, dt / _MOTOR_S)
            self._angles[i] += speeds[i] * dt
        fl, fr, rl, rr = speeds
        quarter = config.WHEEL_RADIUS_M / 4
        self.vx = (fl + fr + rl + rr) * quarter
        self.vy = (-fl + fr + rl - rr) * quarter
        self.wz = (-fl + fr - rl + rr) * quarter / config.LEVER_M
        self.yaw += self.wz * dt
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        self.x += (self.vx * cos - self.vy * sin) * dt
        self.y += (self.vx * sin + self.vy * cos) * dt

    def read_wheels(self, counts):
        """Counts of the encoders, into an array."""
        for i in range(4):
            counts[i] = int(self._angles[i] / (2 * math.pi) * self._config.COUNTS_PER_TURN)

    def drive(self, duties):
        """Power for the motors, -1 to 1."""
        for i in range(4):
            self._duties[i] = duties[i]

    def stop(self):
        """No power."""
        self._duties = [0.0] * 4

    def _random(self, size):
        """Noise, the same every time."""
        self._noise = (self._noise * 75 + 74) % 65537
        return (self._noise / 32768 - 1) * size

    def imu(self, values):
        """Turn rates and accelerations, into an array; whether there are any."""
        values[0], values[1] = self._random(0.002), self._random(0.002)
        values[2] = self.wz + self._random(0.002)
        values[3], values[4] = self._random(0.02), self._random(0.02)
        values[5] = _GRAVITY + self._random(0.02)
        return True

    def _wall(self):
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        ways = [4.0]
        for part, at in ((cos, self.x), (sin, self.y)):
            if abs(part) > 0.001:
                ways.append((math.copysign(_WALL_M, part) - at) / part)
        return max(0.0, min(ways))

    def tof(self):
        """Metres to what is near, infinity if nothing is, None if nothing new was measured."""
        distance = self._wall()
        return distance if distance < 0.2 else math.inf

    def light(self):
        """Lux, or None."""
        return 300 + self._random(4)

    def sonar(self):
        """Metres to what is ahead, infinity if nothing is, None if nothing new was measured."""
        return self._wall()

    def led(self, is_on):
        """The light on the board."""
        self.is_lit = is_on

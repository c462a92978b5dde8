"""Four mecanum wheels: from a wanted motion to motor power, from encoder counts to odometry. No hardware.

Wheels are in the order front left, front right, rear left, rear right. With wheel radius r and lever L (half
the wheelbase plus half the track): fl = (vx - vy - w L) / r, fr = (vx + vy + w L) / r,
rl = (vx + vy - w L) / r, rr = (vx - vy + w L) / r, and the other way round for odometry.
"""

import array
import math

import micropython

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
_FULL_POWER_LIMIT_US = 1000000
_STANDSTILL_RAD_S = 0.3
_NOTHING_RAD_S = 0.001


def _zeros():
    return array.array("f", [0.0] * 4)


class Sum:
    """A sum of many small numbers that a float of 32 bits would lose one by one (after W. Kahan)."""

    def __init__(self):
        self.value = 0.0
        self._lost = 0.0

    def add(self, number):
        """Add it, and what was lost before."""
        number -= self._lost
        total = self.value + number
        self._lost = (total - self.value) - number
        self.value = total


class Drive:
    """Speed loops of the wheels, the limit of a command's life, and where the robot is.

    Args:
        config: The module of that name.
        say: Called with text for a person.

    Attributes:
        angles: Of the wheels, rad.
        speeds: Of the wheels, rad/s, filtered.
        duties: Power for the motors, -1 to 1.
        x, y: Where it is, m (`Sum`).
        yaw: Where it looks, rad, not wrapped.
        vx, vy, wz: How it moves, m/s and rad/s.
    """

    def __init__(self, config, say):
        self._say = say
        self._radius = config.WHEEL_RADIUS_M
        self._lever = config.LEVER_M
        self._most = config.MAX_WHEEL_RAD_S
        self._timeout_ms = config.COMMAND_TIMEOUT_MS
        self._filter_s = config.SPEED_FILTER_S
        self._p = config.SPEED_P
        self._i = config.SPEED_I
        self._forward = 1 / config.MAX_WHEEL_RAD_S
        self._limit = config.MAX_POWER
        self._rad_per_count = 2 * math.pi / config.COUNTS_PER_TURN
        self.angles = _zeros()
        self.speeds = _zeros()
        self.duties = _zeros()
        self._wanted = _zeros()
        self._integrals = _zeros()
        self._last = array.array("i", [0] * 4)
        self._moved = array.array("i", [0] * 4)
        self._blocked_us = array.array("i", [0] * 4)
        self.x = Sum()
        self.y = Sum()
        self.yaw = self.vx = self.vy = self.wz = 0.0
        self._commanded_at = None
        self._is_moving = False

    def command(self, vx, vy, wz, now):
        """Move so until the next command, or until this one is too old. No number, no change."""
        if not (math.isfinite(vx) and math.isfinite(vy) and math.isfinite(wz)):
            return
        radius = self._radius
        turn = wz * self._lever
        wanted = self._wanted
        wanted[0] = (vx - vy - turn) / radius
        wanted[1] = (vx + vy + turn) / radius
        wanted[2] = (vx + vy - turn) / radius
        wanted[3] = (vx - vy + turn) / radius
        most = max(max(wanted), -min(wanted))
        if most > self._most:
            # All slower by the same share, so that the way stays the same.
            for i in range(4):
                wanted[i] *= self._most / most
        self._commanded_at = now

    def stop(self):
        """Stand still."""
        self._commanded_at = None
        for i in range(4):
            self._wanted[i] = 0.0

    @micropython.native
    def update(self, counts, elapsed_us, now):
        """Time went on: encoder counts in, `duties` and odometry out.

        Args:
            counts: Of the four encoders, since the start, forward positive.
            elapsed_us: Since the last time.
            now: In milliseconds.
        """
        if self._commanded_at is not None and now - self._commanded_at > self._timeout_ms:
            self.stop()
        if elapsed_us <= 0:
            return
        dt = elapsed_us / 1000000
        share = min(1.0, dt / self._filter_s)
        per_count = self._rad_per_count
        last, speeds = self._last, self.speeds
        has_moved = False
        for i in range(4):
            count = counts[i]
            moved = count - last[i]
            self._moved[i] = moved
            if moved:
                has_moved = True
                last[i] = count
                self.angles[i] = count * per_count
            if moved or speeds[i]:
                speed = speeds[i]
                speed += share * (moved * per_count / dt - speed)
                speeds[i] = speed if moved or abs(speed) > _NOTHING_RAD_S else 0.0
            self._power(i, dt, moved, elapsed_us)
        if has_moved or self._is_moving:
            self._is_moving = has_moved or max(speeds) > 0 or min(speeds) < 0
            self._locate(counts)

    @micropython.native
    def _power(self, i, dt, moved, elapsed_us):
        """Feed forward what the motor needs at that speed, and mend the rest (PI)."""
        wanted, speed = self._wanted[i], self.speeds[i]
        if wanted == 0 and abs(speed) < _STANDSTILL_RAD_S:
            self.duties[i] = self._integrals[i] = 0.0
            self._blocked_us[i] = 0
            return
        if self._blocked_us[i] >= _FULL_POWER_LIMIT_US:
            self.duties[i] = self._integrals[i] = 0.0
            return
        error = wanted - speed
        limit = self._limit
        duty = wanted * self._forward + self._p * error + self._integrals[i]
        if -limit < duty < limit:
            self._integrals[i] += self._i * error * dt
            self._blocked_us[i] = 0
        else:
            duty = limit if duty > 0 else -limit
            if moved * duty > 0:
                self._blocked_us[i] = 0
            else:
                self._follows_not(i, elapsed_us)
        self.duties[i] = duty

    def _follows_not(self, i, elapsed_us):
        """A motor at full power whose encoder does not follow is switched off until it is to stand still."""
        self._blocked_us[i] += elapsed_us
        if self._blocked_us[i] >= _FULL_POWER_LIMIT_US:
            self._say(
                f"wheel {WHEELS[i]}: full power and its encoder does not follow; switched off. "
                "Check motor and encoder, or change its sign in config.py"
            )

    @micropython.native
    def _locate(self, counts):
        """Where it is, straight from counts: nothing adds up but what really turned."""
        quarter = self._radius / 4
        lever = self._lever
        fl, fr, rl, rr = self.speeds
        self.vx = (fl + fr + rl + rr) * quarter
        self.vy = (-fl + fr + rl - rr) * quarter
        self.wz = (-fl + fr - rl + rr) * quarter / lever
        way = self._rad_per_count * quarter
        yaw = (-counts[0] + counts[1] - counts[2] + counts[3]) * way / lever
        fl, fr, rl, rr = self._moved
        along = (fl + fr + rl + rr) * way
        aside = (-fl + fr + rl - rr) * way
        middle = (self.yaw + yaw) / 2
        cos, sin = math.cos(middle), math.sin(middle)
        self.x.add(along * cos - aside * sin)
        self.y.add(along * sin + aside * cos)
        self.yaw = yaw

"""What the board does when: reads its sensors, drives its wheels, publishes, listens. No hardware."""

import array
import math

import messages
from creation import Topic
from drive import WHEELS, Drive
from xrce import BEST_EFFORT_BYTES, RELIABLE_BYTES, Client

import micropython

_LED_MS = 500


class Timer:
    """Something that is due again and again.

    Args:
        hz: How often.
        phase_ms: When it is due first.
    """

    def __init__(self, hz, phase_ms):
        self._period = max(1, int(1000 / hz))
        self._due = phase_ms

    @micropython.native
    def is_due(self, now):
        """Whether it is time; what was missed is not made up for."""
        return now >= self._due

    def done(self, now):
        """It was done: until the next time."""
        self._due += self._period * ((now - self._due) // self._period + 1)


class Output:
    """A topic that is published: its timer, its message, and what fills that in.

    Args:
        topic: A `creation.Topic`.
        message: One of `messages`.
        fill: Called with the message; False if there is nothing to publish.
        timer: When.
    """

    def __init__(self, topic, message, fill, timer):
        self.topic = topic
        self.message = message
        self.fill = fill
        self.timer = timer


class App:
    """The program, without the line and without the pins.

    Args:
        config: The module of that name.
        hardware: A `hardware.Hardware` or something like it.
        clock: A `clock.Clock`, which goes on by itself.
        send: Called with a buffer and a size: a message for the line.
        say: Called with text for a person.

    Attributes:
        client: Speaks to the bridge.
        drive: Moves the wheels.
    """

    def __init__(self, config, hardware, clock, send, say):
        self._config = config
        self._hardware = hardware
        self._clock = clock
        self.drive = Drive(config, say)
        self._counts = array.array("i", [0] * 4)
        self._six = array.array("f", [0.0] * 6)
        self._outputs = []
        self._topics = []
        self._add_outputs()
        if config.HAS_WHEELS:
            self._topics.append(
                Topic(len(self._topics) + 1, "cmd_vel", messages.Twist.TYPE, True, self._command)
            )
        self.client = Client(self._key(), config.NAME, self._topics, clock, send, say)
        self._control = Timer(config.CONTROL_HZ, 0)
        self._led = Timer(1000 / _LED_MS, 0)
        self._led_is_on = False
        self._moved_at = (0, 0)

    def _add_outputs(self):
        config = self._config
        if config.HAS_WHEELS:
            joints = [name + "_wheel_joint" for name in WHEELS]
            self._add("joint_states", messages.JointState(joints), self._fill_joints)
            odometry = messages.Odometry(
                "odom", "base_link", config.ODOM_POSE_VARIANCES, config.ODOM_TWIST_VARIANCES
            )
            self._add("odom", odometry, self._fill_odometry)
        if config.HAS_IMU:
            imu = messages.Imu("imu_link", config.IMU_GYRO_VARIANCE, config.IMU_ACCEL_VARIANCE)
            self._add("imu/data_raw", imu, self._fill_imu)
        if config.HAS_TOF:
            tof = messages.Range("range_tof", True, 0.44, 0.01, 0.2)
            self._add("sensors/range_tof", tof, self._fill_tof)
            light = messages.Illuminance("range_tof")
            self._add("sensors/illuminance", light, self._fill_light)
        if config.HAS_SONAR:
            sonar = messages.Range("range_ultrasonic", False, 0.26, 0.02, 4.0)
            self._add("sensors/range_ultrasonic", sonar, self._fill_sonar)

    def _add(self, name, message, fill):
        """One more topic; a new one needs a rate in config.py."""
        number = len(self._topics) + 1
        topic = Topic(number, name, message.TYPE, name in self._config.RELIABLE)
        size, most = len(message.data), RELIABLE_BYTES if topic.is_reliable else BEST_EFFORT_BYTES
        if size > most:
            hint = "" if topic.is_reliable else ": name it in RELIABLE in config.py"
            raise ValueError(f"{name} has {size} bytes, {most} are possible{hint}")
        self._topics.append(topic)
        timer = Timer(self._config.RATES_HZ[name], number)
        self._outputs.append(Output(topic, message, fill, timer))

    def _key(self):
        """This board with these topics: another set of topics shall be another client to the bridge."""
        text = ",".join([f"{topic.name}:{topic.type_name}" for topic in self._topics])
        key = 0x811C9DC5
        for byte in text.encode() + self._hardware.identity():
            key = (key ^ byte) * 0x01000193 & 0xFFFFFFFF
        return key.to_bytes(4, "little")

    # -- called from outside -------------------------------------------------------------------

    @micropython.native
    def run(self):
        """Do what is due; call it every millisecond or so."""
        clock = self._clock
        now = clock.ms()
        self._hardware.update(now)
        if self._control.is_due(now):
            self._control.done(now)
            if self._config.HAS_WHEELS:
                self._move(now)
            self._blink(now)
        self.client.run(now)
        for output in self._outputs:
            if output.timer.is_due(now):
                self._publish(output, now)

    def receive(self, message, size):
        """A message of the bridge."""
        self.client.receive(message, size, self._clock.ms())

    def stop(self):
        """Everything off."""
        self._hardware.stop()
        self._hardware.led(False)

    # -- what it does ------------------------------------------------------------------------

    def _command(self, data, at, size):
        if size >= messages.Twist.SIZE:
            vx, vy, wz = messages.Twist.read(data, at)
            self.drive.command(vx, vy, wz, self._clock.ms())

    @micropython.native
    def _move(self, now):
        clock = self._clock
        s, us = self._moved_at
        self._moved_at = (clock.s, clock.us)
        self._hardware.read_wheels(self._counts)
        self.drive.update(self._counts, (clock.s - s) * 1000000 + clock.us - us, now)
        self._hardware.drive(self.drive.duties)

    def _blink(self, now):
        """On when connected, else blinking."""
        if self._led.is_due(now):
            self._led.done(now)
            self._led_is_on = self.client.is_connected or not self._led_is_on
            self._hardware.led(self._led_is_on)

    @micropython.native
    def _publish(self, output, now):
        message = output.message
        if self.client.is_connected:
            if not self.client.can_publish(output.topic, len(message.data)):
                return  # still due: as soon as there is room, and then with what is true then
            if output.fill(message):
                message.stamp(self._clock)
                self.client.publish(output.topic, message.data, now)
        output.timer.done(now)

    # -- what it publishes ---------------------------------------------------------------------

    def _fill_joints(self, message):
        message.fill(self.drive.angles, self.drive.speeds)
        return True

    def _fill_odometry(self, message):
        drive = self.drive
        half = drive.yaw / 2
        message.fill_pose(drive.x.value, drive.y.value, math.sin(half), math.cos(half))
        message.fill_twist(drive.vx, drive.vy, drive.wz)
        return True

    def _fill_imu(self, message):
        if not self._hardware.imu(self._six):
            return False
        message.fill(self._six)
        return True

    def _fill_tof(self, message):
        return self._fill_number(message, self._hardware.tof())

    def _fill_light(self, message):
        return self._fill_number(message, self._hardware.light())

    def _fill_sonar(self, message):
        return self._fill_number(message, self._hardware.sonar())

    def _fill_number(self, message, number):
        if number is None:
            return False
        message.fill(number)
        return True

"""The pins of a Pico (RP2040 or RP2350): the only file, with quadrature.py, that knows there is hardware.

Never run on a real board so far: see the docs. `hardware_sim.py` is the same without pins.
"""

import math
import time

import machine
from machine import I2C, PWM, UART, Pin
from port import StdioPort
from quadrature import Encoder
from sensors import Mpu6050, Vl6180x

import micropython

_FULL = 65535
_SOUND_M_PER_US = 343 / 2 / 1000000
_SONAR_MS = 70
_SONAR_LIMIT_US = 25000
_AGAIN_MS = 5000
_POLL_MS = 20


def open_line(config):
    """The line to the computer, USB or UART."""
    return StdioPort() if config.UART is None else UartPort(config)


class UartPort:
    """A UART, with the interface of `port.StdioPort`."""

    def __init__(self, config):
        self.chunk = bytearray(256)
        self._uart = UART(
            config.UART,
            config.UART_BAUD,
            tx=Pin(config.UART_TX_PIN),
            rx=Pin(config.UART_RX_PIN),
            rxbuf=1024,
            txbuf=2048,
        )
        self.dropped = 0

    def read(self):
        """What came, into `chunk`, without waiting; gives how many bytes."""
        size = min(self._uart.any(), len(self.chunk))
        return self._uart.readinto(self.chunk, size) if size else 0

    def write(self, buffer, size):
        """Send."""
        if self._uart.write(memoryview(buffer)[:size]) != size:
            self.dropped += 1

    def close(self):
        """Give the pins back."""
        self._uart.deinit()


class Motor:
    """A motor behind half an H bridge.

    Args:
        pins: Two inputs, or a PWM input and two direction inputs.
        sign: -1 if it turns the wrong way.
        hz: Of the PWM.
    """

    def __init__(self, pins, sign, hz):
        self._sign = sign
        self._duty = 0.0
        self._directions = (
            [Pin(pin, Pin.OUT, value=0) for pin in pins[1:]] if len(pins) == 3 else None
        )
        powered = pins[:1] if len(pins) == 3 else pins
        self._powers = [PWM(Pin(pin, Pin.OUT, value=0)) for pin in powered]
        for pwm in self._powers:
            pwm.freq(hz)
            pwm.duty_u16(0)

    def drive(self, duty):
        """Power, -1 to 1."""
        if duty == self._duty:
            return
        self._duty = duty
        duty *= self._sign
        power = min(_FULL, int(abs(duty) * _FULL))
        if self._directions:
            self._directions[0].value(duty > 0)
            self._directions[1].value(duty < 0)
            self._powers[0].duty_u16(power)
        else:
            self._powers[0].duty_u16(power if duty > 0 else 0)
            self._powers[1].duty_u16(power if duty < 0 else 0)


class Sonar:
    """HC-SR04: a pulse out, and how long its echo takes, measured by an interrupt."""

    def __init__(self, trigger, echo):
        self._trigger = Pin(trigger, Pin.OUT, value=0)
        self._echo = Pin(echo, Pin.IN)
        self._began_ms = 0
        self._rose = self._fell = 0
        self._has_risen = self._has_fallen = False
        self._distance = None
        # Hard: an edge is stamped when it comes, not when the program has time for it.
        self._echo.irq(self._edge, Pin.IRQ_RISING | Pin.IRQ_FALLING, hard=True)

    def _edge(self, pin):
        if pin.value():
            self._rose = time.ticks_us()
            self._has_risen = True
        elif self._has_risen:
            self._fell = time.ticks_us()
            self._has_fallen = True

    def poll(self, now):
        """End a measurement that is over, and begin the next."""
        if now - self._began_ms < _SONAR_MS:
            return
        if self._began_ms and self._has_risen:
            # It was heard to begin; without an end nothing is in view.
            took = time.ticks_diff(self._fell, self._rose) if self._has_fallen else _SONAR_LIMIT_US
            self._distance = took * _SOUND_M_PER_US if took < _SONAR_LIMIT_US else math.inf
        self._has_risen = self._has_fallen = False
        self._began_ms = now
        self._trigger.value(1)
        time.sleep_us(10)
        self._trigger.value(0)

    def take(self):
        """Metres, infinity if nothing is in view; None if nothing new was measured."""
        distance, self._distance = self._distance, None
        return distance


class Chip:
    """A chip on the bus that may be missing: tried again and again, and said once in a while.

    Args:
        name: For people.
        make: Called without arguments: gives the chip, or raises OSError.
        say: Called with text for a person.
    """

    def __init__(self, name, make, say):
        self._name = name
        self._make = make
        self._say = say
        self._chip = None
        self._try_at = 0

    def use(self, now, job):
        """``job(chip)``, if it is there; whether it was."""
        if self._chip is None and now < self._try_at:
            return False
        try:
            if self._chip is None:
                self._chip = self._make()
            job(self._chip)
            return True
        except OSError as error:
            self._chip = None
            self._try_at = now + _AGAIN_MS
            self._say(
                f"{self._name} does not answer ({error}): check its wires and pins in config.py"
            )
            return False


class Hardware:
    """Everything that is wired to the board.

    Args:
        config: The module of that name.
        say: Called with text for a person.
    """

    NAME = "Pico"

    def __init__(self, config, say):
        self._config = config
        self._led = Pin("LED", Pin.OUT)
        self._motors = []
        self._encoders = []
        self._sonar = self._imu = self._tof = None
        self._now = self._poll_at = 0
        self._is_still = True
        if config.HAS_WHEELS:
            self._add_wheels()
        if config.HAS_IMU or config.HAS_TOF:
            self._add_chips(say)
        if config.HAS_SONAR:
            self._sonar = Sonar(config.SONAR_TRIGGER_PIN, config.SONAR_ECHO_PIN)
        self._watchdog = None
        if config.WATCHDOG_MS:
            self._watchdog = machine.WDT(timeout=config.WATCHDOG_MS)

    def _add_wheels(self):
        config = self._config
        for i in range(4):
            self._motors.append(Motor(config.MOTOR_PINS[i], config.MOTOR_SIGNS[i], config.PWM_HZ))
            a, b = config.ENCODER_PINS[i]
            self._encoders.append(Encoder(i, a, b, config.ENCODER_SIGNS[i]))

    def _add_chips(self, say):
        config = self._config
        bus = I2C(config.I2C, sda=Pin(config.I2C_SDA_PIN), scl=Pin(config.I2C_SCL_PIN), freq=400000)
        if config.HAS_IMU:
            self._imu = Chip("IMU (MPU6050)", lambda: Mpu6050(bus, config.IMU_AXES), say)
        if config.HAS_TOF:
            self._tof = Chip("distance sensor (VL6180X)", lambda: Vl6180x(bus), say)
        self._distance = self._light = None
        self._six = None

    def identity(self):
        """Bytes that are this board's own."""
        return machine.unique_id()

    def pause(self):
        """The loop of the program is short enough without a pause."""

    def update(self, now):
        """What needs to be looked at again and again."""
        self._now = now
        if self._watchdog is not None:
            self._watchdog.feed()
        if now < self._poll_at:
            return
        self._poll_at = now + _POLL_MS
        if self._tof is not None:
            self._tof.use(now, self._poll_tof)
        if self._sonar is not None:
            self._sonar.poll(now)

    def _poll_tof(self, chip):
        chip.poll()
        distance, light = chip.take_distance(), chip.take_light()
        self._distance = self._distance if distance is None else distance
        self._light = self._light if light is None else light

    @micropython.native
    def read_wheels(self, counts):
        """Counts of the encoders, into an array."""
        for i in range(4):
            counts[i] = self._encoders[i].read()

    @micropython.native
    def drive(self, duties):
        """Power for the motors, -1 to 1."""
        is_still = True
        for i in range(4):
            duty = duties[i]
            self._motors[i].drive(duty)
            if duty:
                is_still = False
        self._is_still = is_still

    def stop(self):
        """No power."""
        self._is_still = True
        for motor in self._motors:
            motor.drive(0)

    def imu(self, values):
        """Turn rates and accelerations, into an array; whether there are any."""
        self._six = values
        return self._imu.use(self._now, self._read_imu)

    def _read_imu(self, chip):
        chip.read(self._six, self._is_still)

    def tof(self):
        """Metres to what is near, infinity if nothing is, None if nothing new was measured."""
        distance, self._distance = self._distance, None
        return distance

    def light(self):
        """Lux, or None."""
        light, self._light = self._light, None
        return light

    def sonar(self):
        """Metres to what is ahead, infinity if nothing is, None if nothing new was measured."""
        return self._sonar.take()

    def led(self, is_on):
        """The light on the board."""
        self._led.value(is_on)

"""Wheel encoders counted by the PIO of the chip, at any speed and without the processor.

Both edges of channel A count; channel B says in which direction. A wheel that trembles at an edge counts up
and down and stays where it is.
"""

from array import array

import rp2
from machine import Pin

import micropython


@rp2.asm_pio()
def _count():
    """X goes down for every step one way, Y for every step the other way: neither can be read half done."""
    wrap_target()
    label("a_is_low")
    wait(1, pin, 0)
    jmp(pin, "rose_with_b")
    jmp(x_dec, "a_is_high")
    jmp("a_is_high")
    label("rose_with_b")
    jmp(y_dec, "a_is_high")
    label("a_is_high")
    wait(0, pin, 0)
    jmp(pin, "fell_with_b")
    jmp(y_dec, "a_is_low")
    jmp("a_is_low")
    label("fell_with_b")
    jmp(x_dec, "a_is_low")
    wrap()


_ZERO_X = rp2.asm_pio_encode("set(x, 0)", 0)
_ZERO_Y = rp2.asm_pio_encode("set(y, 0)", 0)
_SHOW_BOTH = [
    rp2.asm_pio_encode(instruction, 0)
    for instruction in ("mov(isr, x)", "push(noblock)", "mov(isr, y)", "push(noblock)")
]


class Encoder:
    """One wheel.

    Args:
        number: Of the state machine, 0 to 3.
        a: Pin of channel A.
        b: Pin of channel B.
        sign: -1 if it counts down when the wheel turns forward.
    """

    def __init__(self, number, a, b, sign):
        pins = [Pin(number, Pin.IN, Pin.PULL_UP) for number in (a, b)]
        machine = rp2.StateMachine(number, _count, in_base=pins[0], jmp_pin=pins[1])
        self._execute, self._get = machine.exec, machine.get
        self._execute(_ZERO_X)
        self._execute(_ZERO_Y)
        # Sixteen bits of each counter are enough between two readings, and cost no memory.
        self._low = array("H", [0, 0])
        self._last = 0
        self._count = 0
        self._sign = sign
        machine.active(1)

    @micropython.native
    def read(self):
        """Steps since the start; call it often enough for fewer than 32768 between two calls."""
        execute = self._execute
        for instruction in _SHOW_BOTH:
            execute(instruction)
        self._get(self._low)
        steps = self._low[1] - self._low[0]
        if steps == self._last:
            return self._count * self._sign
        moved = (steps - self._last) & 0xFFFF
        self._last = steps
        self._count += moved - 0x10000 if moved & 0x8000 else moved
        return self._count * self._sign

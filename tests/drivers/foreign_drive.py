"""A CiA 402 drive, a CiA 406 counter and a CiA 401 module from the standards alone; see `foreign_slave`."""

from __future__ import annotations

from dataclasses import replace

from tests.drivers.foreign_slave import (
    DISABLED,
    ENABLED,
    FAULT,
    MS,
    NOT_READY,
    ON,
    QUICK,
    REACTION,
    READY,
    Rows,
    Slave,
    Traits,
    Wire,
)

WORDS = {
    NOT_READY: 0x00,
    DISABLED: 0x40,
    READY: 0x21,
    ON: 0x23,
    ENABLED: 0x27,
    QUICK: 0x07,
    REACTION: 0x0F,
    FAULT: 0x08,
}
CONTROL, SPEED, TORQUE, MODE = (0x6040, 0), (0x60FF, 0), (0x6071, 0), (0x6060, 0)
TPDO_MAPS = ((0x60410010,), (0x60410010, 0x60640020), (), ())
RPDO_MAPS = ((0x60400010,), (0x60400010, 0x60600008), (0x60400010, 0x60FF0020), ())
"""The default mapping of CiA 402."""
DRIVE_ROWS: Rows = {
    (0x1000, 0): (0x00020192, 4), (0x6007, 0): (1, 2), (0x603F, 0): (0, 2), (0x6040, 0): (0, 2), (0x6041, 0): (0, 2),
    (0x605A, 0): (2, 2), (0x605E, 0): (2, 2), (0x6060, 0): (0, 1), (0x6061, 0): (0, 1), (0x6064, 0): (0, 4),
    (0x606C, 0): (0, 4), (0x6071, 0): (0, 2), (0x6072, 0): (1000, 2), (0x6075, 0): (1600, 4), (0x6076, 0): (637, 4),
    (0x6077, 0): (0, 2), (0x6080, 0): (3000, 4), (0x6083, 0): (100, 4), (0x6084, 0): (100, 4), (0x6085, 0): (100, 4),
    (0x608F, 0): (2, 1), (0x608F, 1): (32768, 4), (0x608F, 2): (1, 4), (0x6091, 0): (2, 1), (0x6091, 1): (1, 4),
    (0x6091, 2): (1, 4), (0x60A9, 0): (0x00B44700, 4), (0x60AA, 0): (0x00C00300, 4), (0x60C2, 0): (2, 1),
    (0x60C2, 1): (1, 1), (0x60C2, 2): (0xFD, 1), (0x60FF, 0): (0, 4), (0x6502, 0): (0x30C, 4),
}  # fmt: skip


class ForeignDrive(Slave):
    """Node 1: a servo amplifier by CiA 402, one transition at a time."""

    fixed = frozenset({0x6041, 0x6061, 0x6064, 0x606C, 0x6075, 0x6076, 0x6077, 0x6502})

    def __init__(self, wire: Wire, traits: Traits | None = None) -> None:
        traits = traits or Traits()
        if not any(traits.tpdo_maps):
            traits = replace(traits, tpdo_maps=TPDO_MAPS)
        if not any(traits.rpdo_maps):
            traits = replace(traits, rpdo_maps=RPDO_MAPS)
        self.speed = self.position = self.code = self.reads = 0
        self.is_enabled_ever = False
        self.controls: list[int] = []
        super().__init__(wire, traits, 1, DRIVE_ROWS)
        self.state = traits.state
        if self.state in (FAULT, REACTION):
            self.code = 0x7305
        if self.state == ENABLED:
            self.word, self.speed = 0x0F, 200

    def power_up(self) -> None:
        super().power_up()
        self.state, self.word, self.mode_shown = DISABLED, 0, 0
        self.wanted: tuple[int, int] | None = None
        self.mode_due = self.cleared_at = 0

    @property
    def is_powered(self) -> bool:
        return self.state in (ENABLED, QUICK, REACTION)

    def live(self) -> Rows:
        return {
            (0x6041, 0): (WORDS[self.state] | self.traits.set_bits, 2), (0x603F, 0): (self.code, 2),
            (0x6061, 0): (self.mode_shown, 1), (0x6064, 0): (self.position, 4), (0x1001, 0): (int(self.code > 0), 1),
            (0x606C, 0): (self.speed or self.tremble(), 4), (0x6077, 0): (self.speed // 2, 2),
        }  # fmt: skip

    def tremble(self) -> int:
        self.reads += 1
        return self.traits.trembles * (1 if self.reads % 2 else -1)

    def accepts(self, key: tuple[int, int], data: bytes) -> bool:
        supported = self.value(0x6502) or 0x30C
        return key != MODE or data[0] == 0 or bool(supported >> (data[0] - 1) & 1)

    def on_store(self, key: tuple[int, int], data: bytes) -> None:
        if key == CONTROL:
            self.control(int.from_bytes(data, "little"))
        elif key == MODE:
            self.mode_due = self.wire.clock.monotonic_ns() + self.traits.mode_ms * MS

    def control(self, word: int) -> None:
        before, self.word = self.word, word
        if word != before:
            self.controls.append(word)
        state, option = self.state, self.value(0x605A, signed=True) if (0x605A, 0) in self.od else 2
        if state in (FAULT, REACTION, NOT_READY):
            if (
                state == FAULT
                and word & 0x80
                and not before & 0x80
                and not self.traits.refuses_reset
            ):
                self.cleared_at = self.wire.clock.monotonic_ns() + self.traits.reset_ms * MS + 1
            return
        if not word & 0x02:
            target = DISABLED
        elif not word & 0x04:
            target = QUICK if state in (ENABLED, QUICK) and option else DISABLED
        elif state == QUICK:
            target = ENABLED if option >= 5 and word & 0x0F == 0x0F else QUICK
        elif not word & 0x01:
            target = READY
        elif state == DISABLED:
            target = DISABLED
        else:
            # One transition at a time: 3 before 4.
            target = (ON if state == READY else ENABLED) if word & 0x08 else ON
        if target != state and self.wanted is None:
            self.wanted = (target, self.wire.clock.monotonic_ns() + self.traits.transition_ms * MS)

    def tick(self, now: int) -> None:
        super().tick(now)
        if self.wanted is not None and now >= self.wanted[1]:
            self.state, self.wanted = self.wanted[0], None
            self.is_enabled_ever |= self.state == ENABLED
            if self.state in self.traits.drops_to:
                self.wanted = (self.traits.drops_to[self.state], now)
            elif self.traits.transition_ms:
                self.control(self.word)
        if self.cleared_at and now >= self.cleared_at:
            self.state, self.code, self.cleared_at = DISABLED, 0, 0
            self.emergency(0)
        if self.state == QUICK:
            self.speed = max(0, abs(self.speed) - self.traits.quick_stop_ramp) * (
                1 if self.speed > 0 else -1
            )
            if not self.speed and self.value(0x605A) < 5:
                self.state = DISABLED
        if now >= self.mode_due:
            self.mode_shown = self.value(*MODE)
        limit = self.value(0x1016, 1) & 0xFFFF
        if limit and self.heard_ns is not None and now - self.heard_ns > limit * MS:
            self.heard_ns = None
            self.fail(0x8130)

    def on_sync(self) -> None:
        if self.state not in (ENABLED, QUICK):
            self.speed = 0
        elif self.state == ENABLED and self.mode_shown in (3, 9):
            self.speed = self.value(*SPEED, signed=True)
        elif self.state == ENABLED and self.mode_shown in (4, 10):
            self.speed += self.value(*TORQUE, signed=True)
        self.position += self.speed

    def fail(self, code: int) -> None:
        """A fault by itself."""
        self.state, self.code, self.wanted, self.speed = FAULT, code, None, 0
        self.emergency(code)


class ForeignCounter(Slave):
    """Node 2: an encoder by CiA 406 that turns by `step` counts per SYNC, its count where `traits` put it."""

    fixed = frozenset({0x6004, 0x6501, 0x6502, 0x6503, 0x6401})

    def __init__(
        self,
        wire: Wire,
        traits: Traits | None = None,
        *,
        step: int = 7,
        start: int = 0,
        place: tuple[int, int] = (0x6004, 0),
        size: int = 4,
        modulus: int = 720_000,
    ) -> None:
        self.step, self.count, self.place, self.size, self.modulus = (
            step,
            start,
            place,
            size,
            modulus,
        )
        super().__init__(wire, traits, 2, {
            (0x1000, 0): (0x00010196, 4), (0x6000, 0): (4, 2), (0x6001, 0): (72_000, 4), (0x6002, 0): (modulus & 0xFFFF_FFFF, 4),  # noqa: E501
            (0x6501, 0): (72_000, 4), (0x6502, 0): (10, 2), (0x6503, 0): (0, 2), place: (0, size),
        })  # fmt: skip

    def live(self) -> Rows:
        return {self.place: (self.count % self.modulus, self.size)}

    def on_sync(self) -> None:
        self.count += self.step


class ForeignInputs(Slave):
    """Node 3: an analogue input module by CiA 401 with one value in an object of `size` bytes."""

    fixed = frozenset({0x6401, 0x6402, 0x6403, 0x6404})

    def __init__(
        self,
        wire: Wire,
        traits: Traits | None = None,
        *,
        place: tuple[int, int] = (0x6401, 1),
        size: int = 2,
        raw: int = 0,
    ) -> None:
        super().__init__(
            wire,
            traits,
            3,
            {
                (0x1000, 0): (0x00040191, 4),
                (0x6423, 0): (0, 1),
                place: (raw, size),
                (place[0], 0): (place[1], 1),
            },
        )

"""One CANopen device as its owner sees it: SDO by object, identity, NMT, heartbeat, and the list of what it lacks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from drivers.bus.cia301 import (
    EMCY_BASE,
    U8,
    U16,
    U32,
    VISIBLE_STRING,
    DataType,
    NmtCommand,
    NmtState,
    ObjectRef,
    object_text,
)
from drivers.bus.dictionary.eds import DeviceDescription
from drivers.bus.network import PumpedBus
from drivers.bus.sdo import SdoAbortError, SdoClient, SdoTimeoutError
from drivers.errors import DecodeError, DriverError, ReadbackError

DEVICE_TYPE: Final = ObjectRef(0x1000, 0, U32, "device type")
SYNC_COB: Final = ObjectRef(0x1005, 0, U32, "COB-ID of SYNC")
_CYCLE_PERIOD: Final = ObjectRef(0x1006, 0, U32, "communication cycle period")
_EMCY_COB: Final = ObjectRef(0x1014, 0, U32, "COB-ID of EMCY")
HEARTBEAT_CONSUMER: Final = ObjectRef(0x1016, 1, U32, "consumer heartbeat time")
HEARTBEAT_PRODUCER: Final = ObjectRef(0x1017, 0, U16, "producer heartbeat time")
SYNC_OVERFLOW: Final = ObjectRef(0x1019, 0, U8, "SYNC counter overflow")
SYNC_GENERATE_BIT: Final = 1 << 30
_SYNC_IDENTIFIER: Final = (1 << 30) - 1
"""Bits of 0x1005 that say which frame the SYNC is: 29 bits, and whether it is one of 29 bits."""
_LENGTH_ABORTS: Final = frozenset({0x06070010, 0x06070012, 0x06070013})


@dataclass(frozen=True)
class Missing:
    """An entry that the device does not offer, and what the rig loses by it."""

    index: int
    subindex: int
    name: str
    consequence: str


@dataclass(frozen=True, kw_only=True)
class Identity:
    """Who a device says that it is: 0x1000, 0x1018, 0x1008 to 0x100A; 0 or empty where it says nothing."""

    device_type: int = 0
    vendor_id: int = 0
    product_code: int = 0
    revision: int = 0
    serial_number: int = 0
    name: str = ""
    hardware_version: str = ""
    software_version: str = ""

    @property
    def profile(self) -> int:
        """The device profile's number: 402 for a drive, 401 for inputs and outputs, 406 for an encoder."""
        return self.device_type & 0xFFFF

    @property
    def is_simulated(self) -> bool:
        """Whether the device says that it is a simulated one: 0x1009 reads "simulated"."""
        return self.hardware_version.strip().lower() == "simulated"

    def as_text(self) -> dict[str, str]:
        """For a run file."""
        return {
            "profile": str(self.profile),
            "vendor_id": f"0x{self.vendor_id:08X}",
            "product_code": f"0x{self.product_code:08X}",
            "revision": f"0x{self.revision:08X}",
            "serial_number": str(self.serial_number),
            "name": self.name,
            "hardware_version": self.hardware_version,
            "software_version": self.software_version,
        }


class RemoteDevice:
    """A node on the bus. What its dictionary lacks is collected in `missing`, once per entry, never
    raised for optional ones.
    """

    def __init__(
        self,
        bus: PumpedBus,
        node_id: int,
        description: DeviceDescription | None = None,
        sdo_timeout_ns: int = 300_000_000,
    ) -> None:
        self.bus, self.node_id, self.description = bus, node_id, description
        self.sdo = SdoClient(bus, node_id, sdo_timeout_ns)
        self.watch = bus.watch(node_id)
        self._missing: dict[tuple[int, int], Missing] = {}
        self._boots = self.watch.boots

    @property
    def has_restarted(self) -> bool:
        """Whether it has announced a start since it was taken over: what was written to it is gone."""
        return self.watch.boots != self._boots

    @property
    def missing(self) -> list[Missing]:
        """What the device turned out not to offer."""
        return list(self._missing.values())

    @property
    def where(self) -> str:
        """The device in an error message."""
        return f"node {self.node_id}"

    def typed(self, entry: ObjectRef) -> ObjectRef:
        """The entry with the number type that the device's EDS gives it, where it gives one and the entry is one
        number.
        """
        if entry.part is not None:
            return entry
        described = (
            self.description.entry(entry.index, entry.subindex) if self.description else None
        )
        if described is None or not described.data_type.is_number or not entry.data_type.is_number:
            return entry
        return ObjectRef(
            entry.index, entry.subindex, described.data_type, entry.name or described.name
        )

    def read(self, entry: ObjectRef) -> int | float:
        """Read an entry that must be there; a device that keeps it in fewer bytes than the standard is understood."""
        return self.number_of(entry, self.sdo.upload(*entry.key))

    def number_of(self, entry: ObjectRef, data: bytes) -> int | float:
        """The number that an entry's bytes stand for."""
        if entry.part is not None:
            return self.number_of(
                ObjectRef(entry.index, entry.subindex, entry.value_type, entry.name),
                data[entry.offset : entry.offset + entry.value_type.size],
            )
        typed = self.typed(entry)
        if 0 < len(data) < typed.data_type.size and not typed.data_type.is_float:
            return int.from_bytes(data, "little", signed=typed.data_type.signed)
        try:
            return typed.data_type.decode(data)
        except DecodeError as error:
            raise DecodeError(
                error.what,
                where=f"{self.where}, {entry}",
                value=error.value,
                limit=f"{error.limit} ({typed.data_type.name})",
            ) from error

    def read_integer(self, entry: ObjectRef) -> int:
        """Read an integer entry that must be there."""
        return int(self.read(entry))

    def read_optional(self, entry: ObjectRef, consequence: str = "") -> int | float | None:
        """Read an entry; None, and a line in `missing`, when the device refuses."""
        try:
            return self.read(entry)
        except SdoAbortError as error:
            self.note_missing(entry, consequence, error)
            return None

    def write(self, entry: ObjectRef, value: float) -> None:
        """Write an entry that must be there; in the device's own length where that is another than the standard's."""
        typed = self.typed(entry)
        try:
            self.sdo.write(typed, value)
        except SdoAbortError as error:
            length = len(self.sdo.upload(*entry.key)) if error.code in _LENGTH_ABORTS else 0
            if not 0 < length <= 8 or length == typed.data_type.size or typed.data_type.is_float:
                raise
            own = DataType(
                typed.data_type.code, f"{length}-byte integer", length, typed.data_type.signed
            )
            self.sdo.write(ObjectRef(entry.index, entry.subindex, own, entry.name), value)

    def write_checked(self, entry: ObjectRef, value: float, consequence: str = "") -> bool:
        """Write an optional entry and read it back; False if the device refuses it. Raises
        `ReadbackError` if it differs.
        """
        try:
            self.write(entry, value)
            read_back = self.read(entry)
        except SdoAbortError as error:
            self.note_missing(entry, consequence, error)
            return False
        if read_back != value:
            raise ReadbackError(
                f"{entry.name or 'a value'} reads back differently",
                where=f"{self.where}, {object_text(*entry.key)}",
                value=read_back,
                limit=f"{value} as written",
                remedy="The device has its own limit for it: see its manual.",
            )
        return True

    def write_wished(self, entry: ObjectRef, value: float, consequence: str = "") -> bool:
        """Write an entry that the rig can do without; False, and a warning, where the device keeps
        a value of its own.
        """
        try:
            return self.write_checked(entry, value, consequence)
        except ReadbackError as error:
            self.bus.emit("warning", "own-value", self.where, str(error))
            return False

    def note_missing(
        self, entry: ObjectRef, consequence: str, error: SdoAbortError | None = None
    ) -> None:
        """Remember that an entry is not offered."""
        if error is not None and not error.is_missing:
            consequence = f"{consequence} ({error.what})" if consequence else error.what
        self._missing.setdefault(
            entry.key, Missing(entry.index, entry.subindex, entry.name, consequence)
        )

    def identity(self) -> Identity:
        """Read who it is. Also the first contact: raises `SdoTimeoutError` when nobody is there."""
        numbers = [
            self.read_optional(
                ObjectRef(0x1018, sub, U32, name),
                "the device cannot be told from another of its kind",
            )
            for sub, name in (
                (1, "vendor-ID"),
                (2, "product code"),
                (3, "revision"),
                (4, "serial number"),
            )
        ]
        vendor, product, revision, serial = (int(n or 0) for n in numbers)
        kind = int(self.read_optional(DEVICE_TYPE, "the device does not say what it is") or 0)
        return Identity(
            device_type=kind,
            vendor_id=vendor,
            product_code=product,
            revision=revision,
            serial_number=serial,
            name=self._text(0x1008, "device name"),
            hardware_version=self._text(0x1009, "hardware version"),
            software_version=self._text(0x100A, "software version"),
        )

    def _text(self, index: int, name: str) -> str:
        try:
            return self.sdo.read_text(index)
        except SdoAbortError as error:
            self.note_missing(
                ObjectRef(index, 0, VISIBLE_STRING, name), "not in the run file", error
            )
            return ""

    def to_pre_operational(self) -> None:
        """Bring the node where SDO works and PDOs are silent, from any NMT state, and make sure that it answers."""
        self.bus.nmt(NmtCommand.PRE_OPERATIONAL, self.node_id)
        self.bus.drain()
        try:
            self._hear_from()
        except SdoTimeoutError:
            # A node that is still booting, or in a state of its own, is given one communication reset.
            self.bus.nmt(NmtCommand.RESET_COMMUNICATION, self.node_id)
            boots = self.watch.boots
            self.bus.wait_for(lambda: self.watch.boots > boots, 2_000_000_000)
            self.bus.nmt(NmtCommand.PRE_OPERATIONAL, self.node_id)
            self._hear_from()
        self._boots = self.watch.boots

    def _hear_from(self) -> None:
        """Make the device answer; that it has no device type is an answer, too."""
        self.read_optional(DEVICE_TYPE, "the device does not say what it is")

    def start(self, timeout_ns: int = 2_000_000_000) -> None:
        """NMT start, confirmed by the node's heartbeat where it produces one."""
        self.bus.nmt(NmtCommand.START, self.node_id)
        if not self.watch.timeout_ns:
            self.watch.state = NmtState.OPERATIONAL
            return
        # A slow heartbeat tells it late.
        patience = max(timeout_ns, self.watch.timeout_ns)
        if not self.bus.wait_for(lambda: self.watch.state is NmtState.OPERATIONAL, patience):
            raise DriverError(
                "the node does not become OPERATIONAL",
                where=self.where,
                value=self.watch.state.name,
                remedy="Its emergency messages and its error register 0x1001 say why.",
            )

    def produce_heartbeat(self, period_ms: int, lost_after: int = 3) -> bool:
        """Let the device send a heartbeat and arm the loss detection after `lost_after` periods; False if it cannot.

        A device that rounds the period, or has one of its own, is watched by what it says; one that says 0 sends none.
        """
        consequence = "the loss of this device shows only by its missing data"
        if not self.write_wished(HEARTBEAT_PRODUCER, period_ms, consequence):
            period_ms = int(self.read_optional(HEARTBEAT_PRODUCER, consequence) or 0)
            if not period_ms:
                self.note_missing(HEARTBEAT_PRODUCER, consequence)
                return False
        self.bus.watch(self.node_id, timeout_ns=lost_after * period_ms * 1_000_000)
        return True

    def consume_heartbeat(self, timeout_ms: int) -> bool:
        """Let the device watch the computer's heartbeat (0x1016); False if it cannot, which costs
        the last line of defence.
        """
        value = self.bus.own_node_id << 16 | timeout_ms
        consequence = "the drive does not notice when the computer dies"
        entry = self._consumer_entry()
        if entry is None:
            self.note_missing(HEARTBEAT_CONSUMER, consequence)
            return False
        try:
            return self.write_checked(entry, value, consequence)
        except ReadbackError:
            entry_value = self.read_integer(entry)
            watched, waits = entry_value >> 16 & 0x7F, entry_value & 0xFFFF
            if watched == self.bus.own_node_id and 0 < waits <= 2 * timeout_ms:
                text = f"the drive waits {waits} ms for the computer, not {timeout_ms} ms"
                self.bus.emit("warning", "own-value", self.where, text)
                return True
            raise

    def release_consumer(self) -> None:
        """Let the device stop watching the computer, before the computer goes away on purpose."""
        entry = self._consumer_entry()
        if entry is not None and int(self.read(entry)) >> 16 & 0x7F == self.bus.own_node_id:
            self.write(entry, 0)

    def _consumer_entry(self) -> ObjectRef | None:
        """The entry of 0x1016 that is ours already, else the first free one, else the first."""
        count = self.read_optional(
            ObjectRef(0x1016, 0, U8, "consumer heartbeat time"), "nobody is watched by the device"
        )
        free: ObjectRef | None = None
        for subindex in range(1, int(count or 0) + 1):
            entry = ObjectRef(0x1016, subindex, U32, "consumer heartbeat time")
            present = self.read_optional(entry)
            if present is None:
                continue
            if int(present) >> 16 & 0x7F == self.bus.own_node_id:
                return entry
            if free is None and int(present) & 0xFFFF == 0:
                free = entry
        return free or (HEARTBEAT_CONSUMER if count else None)

    def listen_to_emergencies(self, texts: Mapping[int, str] | None = None) -> None:
        """Hear the device's EMCY messages also where 0x1014 moved them, with the profile's texts."""
        if texts:
            self.bus.emergency_texts[self.node_id] = texts
        cob_id = self.read_optional(_EMCY_COB, "the device sends no emergency messages")
        if cob_id is None:
            return
        if int(cob_id) >> 31 & 1:
            self.note_missing(_EMCY_COB, "emergency messages are switched off in the device")
        elif int(cob_id) & 0x7FF != EMCY_BASE + self.node_id:
            self.bus.subscribe(
                int(cob_id) & 0x7FF,
                lambda data, stamp_ns: self.bus.on_emergency(self.node_id, data),
            )

    def follow_sync(self) -> None:
        """Make the device a consumer of our SYNC on 0x080 without counter, whose period it does not supervise.

        A computer is late now and then, and some devices answer a SYNC after 1.5 periods with an
        emergency. What the supervision is for, a computer that is dead, its heartbeat tells (0x1016).
        Raises `DriverError` if the device insists on another SYNC.
        """
        cob_id = self.read_optional(
            SYNC_COB, "whether the device follows SYNC 0x080 cannot be checked"
        )
        if cob_id is not None and int(cob_id) & SYNC_GENERATE_BIT:
            # The identifier may change only while the device produces no SYNC.
            self._write_sync(
                int(cob_id) & ~SYNC_GENERATE_BIT,
                "the device produces SYNC itself and cannot be told not to",
            )
        if cob_id is not None and int(cob_id) & _SYNC_IDENTIFIER != 0x080:
            self._write_sync(0x080, "the device follows another SYNC than 0x080: it would be deaf")
        if overflow := self._sync_overflow():
            raise DriverError(
                "the device insists on a SYNC with counter",
                where=f"{self.where}, {object_text(*SYNC_OVERFLOW.key)}",
                value=overflow,
                limit="0",
                remedy="Set the synchronous counter overflow value to 0 with the vendor's "
                "tool: without it the device is deaf.",
            )
        if self.read_optional(_CYCLE_PERIOD, "the device does not supervise the SYNC period"):
            self.write_wished(_CYCLE_PERIOD, 0)

    def _write_sync(self, value: int, otherwise: str) -> None:
        """Write 0x1005; bit 31 means nothing there. Raises `DriverError` saying `otherwise` if the
        device keeps its own.
        """
        try:
            self.write(SYNC_COB, value)
            sync_cob = self.read_integer(SYNC_COB)
        except SdoAbortError:
            sync_cob = self.read_integer(SYNC_COB)
        if (sync_cob ^ value) & (SYNC_GENERATE_BIT | _SYNC_IDENTIFIER):
            raise DriverError(
                otherwise,
                where=f"{self.where}, {object_text(*SYNC_COB.key)}",
                value=f"0x{sync_cob:08X}",
                limit="0x00000080",
                remedy="Set the COB-ID of SYNC with the vendor's tool.",
            )

    def _sync_overflow(self) -> int:
        overflow = int(self.read_optional(SYNC_OVERFLOW, "SYNC without counter") or 0)
        if overflow:
            # CiA 301 allows a change of 0x1019 only while the cycle period is 0.
            self.write_checked(_CYCLE_PERIOD, 0)
            if self.write_checked(SYNC_OVERFLOW, 0, "SYNC must carry a counter"):
                return 0
        return overflow

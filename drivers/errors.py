"""The one error root of this floor. A message says what, where, value, limit, and what to do next."""

from __future__ import annotations


class DriverError(RuntimeError):
    """A device, a bus or a frame that is not what it must be.

    `what` is the sentence; `where` the node, object or channel; `value` what was found; `limit`
    what is allowed; `remedy` what to do next. All of them stay readable as attributes.
    """

    def __init__(
        self, what: str, *, where: str = "", value: object = None, limit: str = "", remedy: str = ""
    ) -> None:
        self.what, self.where, self.value, self.limit, self.remedy = (
            what,
            where,
            value,
            limit,
            remedy,
        )
        text = f"{where}: {what}" if where else what
        if value is not None:
            text += f"; value {value}"
        if limit:
            text += f", allowed {limit}"
        if remedy:
            text += f". {remedy}"
        super().__init__(text)


class BusLostError(DriverError):
    """The bus, the hub or the line is gone: nothing can be sent or received any more."""


class OtherMasterError(DriverError):
    """Somebody else commands the bus: a rig has one master. Nothing was moved, nothing of theirs was touched."""


class StaleDataError(DriverError):
    """No complete cycle came back within the time allowed."""


class ReadbackError(DriverError):
    """A value that was written reads back differently."""


class DecodeError(DriverError):
    """Bytes that are not what the device's protocol says."""

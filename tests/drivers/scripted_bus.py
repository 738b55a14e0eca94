"""A bus that plays a script of frames: what must be sent, and what comes back. Frames left over fail the test."""

from __future__ import annotations

from collections import deque

from drivers.python_can import can

Frame = tuple[int, bytes]


def frame(text: str) -> Frame:
    """ "601 40 41 60 00 00 00 00 00" as the manuals print it."""
    cob_id, *data = text.split()
    return int(cob_id, 16), bytes(int(byte, 16) for byte in data)


class ScriptedBus:
    """Sends are compared with the script; each one releases the replies that stand behind it."""

    def __init__(self, script: list[tuple[str, list[str]]] | None = None) -> None:
        self.script = deque(
            (frame(sent), [frame(r) for r in replies]) for sent, replies in script or []
        )
        self.waiting: deque[can.Message] = deque()
        self.sent: list[Frame] = []
        self.is_free = script is None
        self.is_gone = False

    def send(self, msg: can.Message) -> None:
        if self.is_gone:
            raise can.CanOperationError("no such device")
        self.sent.append((msg.arbitration_id, bytes(msg.data)))
        if self.is_free:
            return
        assert self.script, f"sent beyond the script: {msg}"
        expected, replies = self.script.popleft()
        assert (msg.arbitration_id, bytes(msg.data)) == expected, (
            f"{msg.arbitration_id:X} {msg.data.hex(' ')}"
        )
        for cob_id, data in replies:
            self.feed(cob_id, data)

    def feed(self, cob_id: int, data: bytes, stamp: float = 0.0) -> None:
        self.waiting.append(
            can.Message(arbitration_id=cob_id, data=data, is_extended_id=False, timestamp=stamp)
        )

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.is_gone:
            raise can.CanOperationError("no such device")
        return self.waiting.popleft() if self.waiting else None

    def shutdown(self) -> None:
        self.is_gone = True

    def assert_finished(self) -> None:
        assert not self.script, f"not sent: {list(self.script)}"
        assert not self.waiting, f"not received: {list(self.waiting)}"

"""A socketcand hub on loopback: any CANopen tool that speaks socketcand can join the simulated bus.

Protocol: `< hi >`, `< open NAME >`, `< ok >`, `< rawmode >`, `< ok >`, then `< send ID DLC BYTES >`
from a client and `< frame ID SECONDS DATA >` to all others. Each frame carries the time stamp of
the simulated adapter, so that a client sees simulated hardware stamps.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

Frame = tuple[int, bytes]
Listener = Callable[[int, int, bytes], None]
"""Takes a frame from a client: the client's key, COB-ID, data. It hands the frame on to the others by `broadcast`."""

LONGEST_LINE = 512
"""Bytes without a closing bracket after which a client is disconnected."""
_LAST_ARRIVAL = 0.02
"""Seconds after the door has been closed within which those in the door are in."""
_LONGEST_GOODBYE = 2.0
"""Seconds that closed connections have to end."""
_LARGEST_BACKLOG = 1 << 20
"""Bytes that a client may leave unread before it is disconnected."""


class Visitors:
    """Who is connected, greeted or not: so that a server that stops leaves nobody hanging and no task behind."""

    def __init__(self) -> None:
        self._present: dict[asyncio.Task[None], asyncio.StreamWriter] = {}

    def enter(self, writer: asyncio.StreamWriter) -> None:
        """Note the connection that the running task serves."""
        task = asyncio.current_task()
        assert task is not None
        self._present[task] = writer
        task.add_done_callback(lambda done: self._present.pop(done, None))

    async def leave(self) -> None:
        """Close every connection and wait until whoever served it is done. Nobody must be let in any more."""
        # Who was accepted just now still has to come in.
        await asyncio.sleep(_LAST_ARRIVAL)
        for writer in self._present.values():
            writer.close()
        if self._present:
            await asyncio.wait(list(self._present), timeout=_LONGEST_GOODBYE)


class Hub:
    """The hub: frames from a client go to the listener, `broadcast` sends a frame to every client but one."""

    def __init__(self, channel: str, listener: Listener) -> None:
        self._channel = channel
        self._listener = listener
        self._clients: dict[int, asyncio.StreamWriter] = {}
        self._visitors = Visitors()
        self._server: asyncio.Server | None = None

    async def start(self, host: str, port: int) -> int:
        """Listen; returns the port (port 0 takes a free one)."""
        self._server = await asyncio.start_server(self._serve, host, port)
        return int(self._server.sockets[0].getsockname()[1])

    async def stop(self) -> None:
        """Disconnect everybody and listen no more."""
        if self._server is not None:
            self._server.close()
        await self._visitors.leave()
        if self._server is not None:
            with contextlib.suppress(ConnectionError):
                await self._server.wait_closed()

    def disconnect(self) -> None:
        """Disconnect everybody."""
        for writer in list(self._clients.values()):
            writer.close()

    def broadcast(self, cob_id: int, data: bytes, stamp_ns: int, *, but: int | None = None) -> None:
        """Send a frame to every client (except the one it came from)."""
        line = frame_line(cob_id, data, stamp_ns)
        for key, writer in list(self._clients.items()):
            if key == but or writer.is_closing():
                continue
            if writer.transport.get_write_buffer_size() > _LARGEST_BACKLOG:
                # Who does not read would fill the memory.
                writer.close()
            else:
                writer.write(line)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        key = id(writer)
        self._visitors.enter(writer)
        try:
            writer.write(b"< hi >")
            await self._greet(reader, writer)
            self._clients[key] = writer
            while True:
                frame = parse_send(await read_message(reader))
                if frame is not None:
                    self._listener(key, *frame)
        except (asyncio.IncompleteReadError, asyncio.LimitOverrunError, ConnectionError):
            return
        finally:
            self._clients.pop(key, None)
            writer.close()

    async def _greet(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while True:
            words = (await read_message(reader)).split()
            if words[:1] == ["open"]:
                is_own_channel = words[1:2] == [self._channel]
                writer.write(b"< ok >" if is_own_channel else b"< error could not open bus >")
            elif words == ["rawmode"]:
                writer.write(b"< ok >")
                return
            elif words == ["echo"]:
                writer.write(b"< echo >")
            await writer.drain()


async def read_message(reader: asyncio.StreamReader) -> str:
    """The words between the next pair of brackets."""
    raw = await reader.readuntil(b">")
    if len(raw) > LONGEST_LINE:
        raise ConnectionResetError("a message that never ends")
    return raw.decode("ascii", "replace").partition("<")[2].rstrip(">").strip()


def parse_send(message: str) -> Frame | None:
    """(COB-ID, data) of a `send` message, None for anything else."""
    words = message.split()
    if len(words) < 3 or words[0] != "send":
        return None
    try:
        # More than three digits are a 29-bit identifier, whatever its number.
        cob_id, length = int(words[1], 16) if len(words[1]) <= 3 else -1, int(words[2])
        data = bytes(int(word, 16) for word in words[3:])
    except ValueError:
        return None
    return (cob_id, data) if len(data) == length <= 8 and 0 <= cob_id < 0x800 else None


def frame_line(cob_id: int, data: bytes, stamp_ns: int) -> bytes:
    """A `frame` message with the time of the simulated bus."""
    seconds, rest = divmod(stamp_ns, 1_000_000_000)
    # Three digits: clients tell an 11-bit identifier from a 29-bit one by that.
    return f"< frame {cob_id:03X} {seconds}.{rest // 1000:06d} {data.hex().upper()} >".encode(
        "ascii"
    )

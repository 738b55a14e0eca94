"""The wire bench as a process of its own: a socketcand hub on loopback and the readout on a pty or a socket.

Everything runs in one asyncio loop, in one thread. Heartbeats and timers follow the wall clock. The
plant runs one cycle per SYNC; with `time="wall"` it also goes on by the clock while the SYNC stays
away, with `time="sync"` it waits for the SYNC, so that the same commands give the same counts
however fast the client is.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from drivers.clock import WallClock
from drivers.errors import DriverError
from model.gear import HarmonicDrive, Mounting
from model.motor import ServoMotor
from sim_backend.faults import Fault
from sim_backend.imperfections import Imperfections
from sim_backend.wire.bench import WireBench
from sim_backend.wire.hub import Hub, Visitors
from sim_backend.world import FIRST_WORLD, ThermalState, World

_LONGEST_SLEEP = 0.02
"""Seconds after which the devices' timers are looked at again."""
_MEASURING_TIME = 0.0026
"""Seconds from the request to the readout's answer: 1 ms until the value is stored and 187 bits at 115200 Bd."""
TimeSource = Literal["wall", "sync"]
ReadoutLine = Literal["pty", "socket"]


@dataclass(frozen=True)
class Addresses:
    """Where the simulated rig can be reached: socketcand host, port and channel, and the readout's URL for pyserial."""

    host: str
    port: int
    channel: str
    readout: str = ""


class Server:
    """A bench behind a hub; `start` it, let `run` turn its timers, `stop` it."""

    def __init__(
        self, bench: WireBench, *, channel: str = "can0", readout: ReadoutLine | None = None
    ) -> None:
        self.bench = bench
        self.receives_own = True
        self._hub = Hub(channel, self._from_client)
        self._channel, self._readout = channel, readout
        self._sender: int | None = None
        self._ends: tuple[int, ...] = ()
        self._lines: asyncio.Server | None = None
        self._visitors = Visitors()

    async def start(self, host: str = "127.0.0.1", port: int = 0) -> Addresses:
        """Listen. Raises `DriverError` when the port is taken or there are no pseudo-terminals."""
        try:
            bound = await self._hub.start(host, port)
            readout = await self._open_readout(host)
        except OSError as error:
            await self.stop()
            raise DriverError(
                f"the simulated rig cannot listen: {error}",
                where=f"{host}:{port}",
                remedy="Choose another port, or 0.",
            ) from error
        self.bench.listen(self, self._from_bench)
        return Addresses(host, bound, self._channel, readout)

    async def run(self, until: asyncio.Event) -> None:
        """Turn the devices' timers until the event is set."""
        while not until.is_set():
            self.bench.elapse()
            if self.bench.is_lost:
                self._hub.disconnect()
            wait = (self.bench.next_due_ns() - self.bench.clock.monotonic_ns()) * 1e-9
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(until.wait(), min(max(wait, 0.0), _LONGEST_SLEEP))

    async def stop(self) -> None:
        """Disconnect everybody."""
        self.bench.leave(self)
        await self._hub.stop()
        ends, self._ends = self._ends, ()
        if ends:
            asyncio.get_running_loop().remove_reader(ends[0])
        for end in ends:
            os.close(end)
        if self._lines is not None:
            self._lines.close()
        await self._visitors.leave()

    def _from_client(self, key: int, cob_id: int, data: bytes) -> None:
        if self.bench.is_lost:
            self._hub.disconnect()
            return
        self._sender = key
        self.bench.send(cob_id, data, self)
        self._sender = None

    def _from_bench(self, cob_id: int, data: bytes, stamp_ns: int) -> None:
        # The first frame after a client has sent is its own: the others hear it, it does not.
        sender, self._sender = self._sender, None
        self._hub.broadcast(cob_id, data, stamp_ns, but=sender)

    async def _open_readout(self, host: str) -> str:
        if self._readout == "pty":
            return self._open_pty()
        if self._readout == "socket":
            self._lines = await asyncio.start_server(self._serve_line, host, 0)
            return f"socket://{host}:{self._lines.sockets[0].getsockname()[1]}"
        return ""

    def _open_pty(self) -> str:
        if sys.platform == "win32":
            raise DriverError(
                "there are no pseudo-terminals on Windows",
                where="--readout",
                value="pty",
                limit="socket",
            )
        import tty

        master, slave = os.openpty()
        self._ends = (master, slave)
        for end in self._ends:
            # Both ends raw: else the terminal eats STX and CR.
            tty.setraw(end)
        os.set_blocking(master, False)
        asyncio.get_running_loop().add_reader(master, self._read_pty, master)
        return os.ttyname(slave)

    def _read_pty(self, master: int) -> None:
        try:
            answer = self._answer(os.read(master, 256))
        except OSError:
            return
        if answer:
            asyncio.get_running_loop().call_later(_MEASURING_TIME, self._write_pty, master, answer)

    def _write_pty(self, master: int, answer: bytes) -> None:
        if self._ends:
            with contextlib.suppress(OSError):
                os.write(master, answer)

    async def _serve_line(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._visitors.enter(writer)
        try:
            while data := await reader.read(256):
                answer = self._answer(data)
                if answer:
                    await asyncio.sleep(_MEASURING_TIME)
                    writer.write(answer)
                    await writer.drain()
        except ConnectionError:
            return
        finally:
            writer.close()

    def _answer(self, request: bytes) -> bytes:
        answer = self.bench.readout.receive(request)
        for fault in self.bench.wire_faults():
            answer = fault.alter_from_readout(answer)
        return answer


def make_bench(
    gear: HarmonicDrive,
    motor: ServoMotor,
    imperfections: Imperfections | None = None,
    world: World = FIRST_WORLD,
    *,
    time: TimeSource = "wall",
    cycle_ns: int = 1_000_000,
    mounting: Mounting = "circular-spline-fixed",
    gear_mounted: bool = True,
    disc_inertia: float = 0.0,
    faults: Sequence[Fault] = (),
    start: ThermalState | None = None,
) -> WireBench:
    """The bench of a process of its own, in wall time; parameters as of `WireBench`."""
    return WireBench(
        gear,
        motor,
        imperfections,
        world,
        cycle_ns=cycle_ns,
        mounting=mounting,
        gear_mounted=gear_mounted,
        disc_inertia=disc_inertia,
        clock=WallClock(),
        faults=faults,
        start=start,
        silence_cycles=1 if time == "wall" else None,
    )


def serve(
    bench: WireBench,
    *,
    host: str = "127.0.0.1",
    port: int = 29536,
    channel: str = "can0",
    readout: ReadoutLine | None = "pty",
    announce: Callable[[Addresses], None] | None = None,
    lifetime: float | None = None,
) -> None:
    """Serve a bench until the process is interrupted or terminated, or for `lifetime` seconds.

    `announce` is told where the rig can be reached, once it can be. Raises `DriverError` when the port is taken.
    """
    # Ctrl-C where the system has no signal handlers for loops.
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(
            _serve(
                bench,
                host,
                port,
                channel=channel,
                readout=readout,
                announce=announce,
                lifetime=lifetime,
            )
        )


async def _serve(
    bench: WireBench,
    host: str,
    port: int,
    channel: str,
    readout: ReadoutLine | None,
    announce: Callable[[Addresses], None] | None,
    lifetime: float | None,
) -> None:
    server, until = Server(bench, channel=channel, readout=readout), asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        # Not in the main thread, or not on this system: the caller ends it by `lifetime` or by its own means.
        with contextlib.suppress(NotImplementedError, RuntimeError, ValueError):
            loop.add_signal_handler(number, until.set)
    if lifetime is not None:
        loop.call_later(lifetime, until.set)
    addresses = await server.start(host, port)
    try:
        if announce is not None:
            announce(addresses)
        await server.run(until)
    finally:
        await server.stop()

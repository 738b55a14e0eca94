"""The SDO server of a simulated slave: expedited and segmented transfer in both directions, aborts (CiA 301, 7.2.4).

Block transfer is not offered: a block request is answered with the abort "command specifier not valid", as the standard
allows; clients then fall back to segments.
"""

from __future__ import annotations

import struct

from sim_backend.wire.dictionary import Abort, AbortError, ObjectDictionary

_LONGEST_DOWNLOAD = 4096
"""Bytes a segmented download may bring before the device is out of memory."""


class SdoServer:
    """One server channel: give it the request's eight bytes, it returns the response's (or None)."""

    def __init__(self, dictionary: ObjectDictionary) -> None:
        self._dictionary = dictionary
        self.reset()

    def reset(self) -> None:
        """Forget a transfer under way."""
        self._direction = ""
        self._index, self._sub = 0, 0
        self._buffer = b""
        self._announced = 0
        self._toggle = 0

    def handle(self, request: bytes) -> bytes | None:
        """The answer to one request frame."""
        if len(request) < 8:
            return None
        try:
            return self._answer(request)
        except AbortError as refused:
            index, sub = self._index, self._sub
            self.reset()
            return struct.pack("<BHBI", 0x80, index, sub, refused.code)

    def _answer(self, request: bytes) -> bytes | None:
        command = request[0] >> 5
        if command == 4:
            self.reset()
            return None
        if command in (1, 2):
            self.reset()
            self._index, self._sub = struct.unpack_from("<HB", request, 1)
            return self._start_download(request) if command == 1 else self._start_upload()
        if command == 0 and self._direction == "download":
            return self._download_segment(request)
        if command == 3 and self._direction == "upload":
            return self._upload_segment(request)
        if command in (5, 6):
            self._index, self._sub = struct.unpack_from("<HB", request, 1)
        raise AbortError(Abort.COMMAND)

    def _start_download(self, request: bytes) -> bytes:
        expedited, sized = request[0] & 2, request[0] & 1
        if expedited:
            length = 4 - ((request[0] >> 2) & 3) if sized else self._natural_length()
            self._dictionary.download(self._index, self._sub, request[4 : 4 + length])
        else:
            entry = self._dictionary.writable(self._index, self._sub)
            self._announced = struct.unpack_from("<I", request, 4)[0] if sized else 0
            if self._announced > _LONGEST_DOWNLOAD:
                raise AbortError(Abort.OUT_OF_MEMORY)
            if entry.type.length and self._announced > entry.type.length:
                raise AbortError(Abort.TOO_LONG)
            self._direction = "download"
        return struct.pack("<BHB4x", 0x60, self._index, self._sub)

    def _natural_length(self) -> int:
        return self._dictionary.entry(self._index, self._sub).type.length or 4

    def _download_segment(self, request: bytes) -> bytes:
        toggle = (request[0] >> 4) & 1
        if toggle != self._toggle:
            raise AbortError(Abort.TOGGLE)
        self._buffer += request[1 : 8 - ((request[0] >> 1) & 7)]
        if len(self._buffer) > _LONGEST_DOWNLOAD:
            raise AbortError(Abort.OUT_OF_MEMORY)
        self._toggle ^= 1
        if request[0] & 1:
            if self._announced and len(self._buffer) != self._announced:
                raise AbortError(Abort.LENGTH)
            self._dictionary.download(self._index, self._sub, self._buffer)
            self.reset()
        return struct.pack("<B7x", 0x20 | (toggle << 4))

    def _start_upload(self) -> bytes:
        data = self._dictionary.upload(self._index, self._sub)
        if 1 <= len(data) <= 4:
            command = 0x43 | ((4 - len(data)) << 2)
            return struct.pack("<BHB4s", command, self._index, self._sub, data)
        self._direction, self._buffer = "upload", data
        return struct.pack("<BHBI", 0x41, self._index, self._sub, len(data))

    def _upload_segment(self, request: bytes) -> bytes:
        toggle = (request[0] >> 4) & 1
        if toggle != self._toggle:
            raise AbortError(Abort.TOGGLE)
        part, self._buffer = self._buffer[:7], self._buffer[7:]
        self._toggle ^= 1
        last = not self._buffer
        command = (toggle << 4) | ((7 - len(part)) << 1) | int(last)
        if last:
            self.reset()
        return struct.pack("<B7s", command, part)

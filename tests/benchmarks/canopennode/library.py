"""CANopenNode as a shared library: built by gcc from a checkout, with our driver, and its functions for ctypes."""

from __future__ import annotations

import ctypes
import hashlib
import os
import subprocess
import tempfile
from ctypes import CFUNCTYPE, POINTER, c_char_p, c_int, c_uint8, c_uint16, c_uint32, c_void_p
from pathlib import Path

CHECKOUT = "CANOPENNODE"
"""Environment variable that names the checkout."""
TRIED = "9b8beed8367241e96ac03f916cd5a500bcb2cf23"
"""The commit of github.com/CANopenNode/CANopenNode (Apache-2.0) with which the documented figures were made."""
SOURCES = ("CANopen.c", *(
    f"301/CO_{part}.c"
    for part in ("ODinterface", "NMT_Heartbeat", "HBconsumer", "Emergency", "SDOserver", "SYNC", "PDO")
))  # fmt: skip
HERE = Path(__file__).parent

Send = CFUNCTYPE(None, c_uint16, POINTER(c_uint8), c_uint8)
Write = CFUNCTYPE(c_int, c_uint16, c_uint8, POINTER(c_uint8), c_uint32, c_int)
State = CFUNCTYPE(None, c_int)
Lost = CFUNCTYPE(None, c_int)


def checkout() -> Path:
    """Where CANopenNode lies. Raises `FileNotFoundError` where the environment names none."""
    named = Path(os.environ.get(CHECKOUT, "CANopenNode"))
    if not (named / "CANopen.c").is_file():
        raise FileNotFoundError(
            f"no CANopenNode in {named}: git clone https://github.com/CANopenNode/CANopenNode, git checkout {TRIED}, "
            f"and name the folder in {CHECKOUT}"
        )
    return named


def built(source: Path) -> Path:
    """The library of these sources, made once."""
    own = [HERE / name for name in ("node.c", "CO_driver_target.h", "stack_config.h")]
    parts = [source / name for name in SOURCES]
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in (*own, *parts))).hexdigest()
    library = Path(tempfile.gettempdir()) / f"canopennode-{digest[:16]}.so"
    if not library.exists():
        made = library.with_suffix(f".{os.getpid()}")
        subprocess.run(
            ["gcc", "-shared", "-fPIC", "-O2", "-Wall", "-include", HERE / "stack_config.h", f"-I{HERE}",
             f"-I{source}", own[0], *parts, "-o", made],
            check=True,
        )  # fmt: skip
        made.rename(library)
    return library


def load() -> ctypes.CDLL:
    """The library, its functions with their types."""
    library = ctypes.CDLL(str(built(checkout())))
    types: dict[str, tuple[object, list[object]]] = {
        "node_new": (c_void_p, [c_uint8, Send, Write, State, Lost]),
        "node_object": (
            c_int,
            [c_void_p, c_uint16, c_uint8, c_int, c_uint8, c_char_p, c_uint32, c_int],
        ),
        "node_memory": (c_void_p, [c_void_p, c_uint16, c_uint8]),
        "node_start": (c_int, [c_void_p]),
        "node_process": (c_uint32, [c_void_p, c_uint32, c_uint32]),
        "node_receive": (None, [c_void_p, c_uint16, c_char_p, c_uint8]),
        "node_state": (c_int, [c_void_p]),
        "node_set_state": (None, [c_void_p, c_int]),
        "node_error": (None, [c_void_p, c_int, c_uint16, c_uint32, c_int]),
        "node_delete": (None, [c_void_p]),
    }
    for name, (result, arguments) in types.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library

"""A hub: a bench that is reached over the network (socketcand). Its identity is its address.

Two descriptions of one address are one bench, whatever they call it; so nobody takes the nodes of
a running rig away from it with another `rig.toml`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

INTERFACE = "socketcand"
"""The interface of python-can by which a hub is reached."""
_OWN = {"localhost": "127.0.0.1", "::1": "127.0.0.1"}
"""Names of this very computer."""


def hub_id(host: str, port: int | str, channel: int | str) -> str:
    """The identity of the bench at an address, fit to name a folder."""
    address = f"hub-{_OWN.get(host.lower(), host.lower())}-{port}-{channel}"
    return re.sub(r"[^a-z0-9]+", "-", address.lower()).strip("-")


def hub_of(
    interface: str, channel: int | str, arguments: Mapping[str, str | int | float | bool]
) -> str:
    """The identity of the hub that a bus is; "" for a bus that is none."""
    if interface.lower() != INTERFACE:
        return ""
    return hub_id(str(arguments.get("host", "")), str(arguments.get("port", "")), channel)

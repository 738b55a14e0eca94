"""The checks that our own protocols and sources pass, for the suite of a package that brings one."""

from rig.testing.protocol import check_protocol
from rig.testing.source import check_source

__all__ = ["check_protocol", "check_source"]

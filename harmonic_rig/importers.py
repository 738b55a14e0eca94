"""A kind of file of another package: an `Importer` behind an entry point of the group `harmonic_rig.importers`."""

from rig.errors import RunFileError
from rig.runfile.importing.opening import Importer

__all__ = ["Importer", "RunFileError"]

"""The error root of the application. A message says what, where, value, limit, and what to do next."""

from __future__ import annotations

from model.errors import WordedError


class RigError(WordedError, RuntimeError):
    """Something that the application cannot do: a file, a configuration, a limit, a rig."""


class RunFileError(RigError):
    """A run file that cannot be read, written, trusted or recovered."""


class ChangedRunError(RunFileError):
    """A run, or what rests on one (an analysis, a campaign's journal), whose bytes are not those that were sealed."""


class UnsealedError(ChangedRunError):
    """A file that was sealed when it was made, and whose note of the SHA-256 is gone."""


class RecorderOverflowError(RigError):
    """The recorder's ring is full: the run stops rather than lose rows in silence."""


class LimitError(RigError):
    """A plan or a set-point that would break a limit."""


class ConfigurationError(RigError):
    """A configuration file with a wrong or missing value."""


class BenchInUseError(RigError):
    """A bench that another process has; nothing was connected."""

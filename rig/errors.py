"""The error root of the application. A message says what, where, value, limit, and what to do next."""

from __future__ import annotations

from collections.abc import Iterable

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


def misstated(error: WordedError, where: str | None = None) -> ConfigurationError:
    """The same words of a value that somebody stated, at `where` if it is known better."""
    return ConfigurationError(
        error.what,
        where=error.where if where is None else where,
        value=error.value,
        limit=error.limit,
        remedy=error.remedy,
    )


def nearest(word: str, words: Iterable[str]) -> str:
    """What may have been meant by a word that there is not, else all that there are."""
    import difflib

    words = tuple(words)
    # The dashes of a flag are no letters that it shares with another.
    bare = {one.lstrip("-"): one for one in words}
    near = [bare[one] for one in difflib.get_close_matches(word.lstrip("-"), bare, n=2)]
    return f"Did you mean {' or '.join(near)}?" if near else f"There are: {', '.join(words)}."

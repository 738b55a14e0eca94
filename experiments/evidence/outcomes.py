"""What one check found of a recording, before the table of checks gives it its name and its remedy.

`found` and `allowed` are values with their units; `words` say what follows.
"""

from __future__ import annotations

from experiments.finding import Finding, Severity


def passed(found: str = "", allowed: str = "") -> Finding:
    """The recording is what it must be."""
    return Finding("", Severity.PASSED, found, allowed=allowed)


def noted(found: str, allowed: str, words: str) -> Finding:
    """It is not, and what is computed from it says so: an uncertainty is wider, or a remark stands beside it."""
    return Finding("", Severity.NOTES, found, allowed=allowed, follows=words)


def refused(found: str, allowed: str, words: str) -> Finding:
    """Nothing is computed from it."""
    return Finding("", Severity.BLOCKS, found, allowed=allowed, follows=words)


def refused_beyond(is_beyond: bool, found: str, allowed: str, words: str) -> Finding:
    """Refused in these words where the value is beyond what is allowed, else passed."""
    return refused(found, allowed, words) if is_beyond else passed(found, allowed)


def not_checked(why: str) -> Finding:
    """The recording lacks what the check needs, or the run has nothing that it applies to."""
    return Finding("", Severity.NOT_LOOKED_AT, why)

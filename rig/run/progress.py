"""Durations as people say them."""

from __future__ import annotations


def in_words(seconds: float) -> str:
    """A duration as people say it: 48 s, 12 min 05 s, 1 h 20 min."""
    whole = round(seconds)
    if whole < 120:
        return f"{whole} s"
    if whole < 7200:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"

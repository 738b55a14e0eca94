"""The laboratory as it stands on a certificate: its name and address, its logo, customer, order and method."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rig.bench.config.load import load_laboratory
from rig.errors import ConfigurationError
from rig.present.certificate.words import ENGLISH, Words, words_of

_LARGEST_LOGO = 500_000
"""Bytes."""
FORMATS = {
    b"\x89PNG\r\n\x1a\n": "png",
    b"\xff\xd8\xff": "jpg",
    b"<svg": "svg",
    b"<?xml": "svg",
}
"""How the files of pictures begin, and what they are called."""


@dataclass(frozen=True)
class Logo:
    """A picture: its bytes and its format (png, jpg, svg)."""

    content: bytes
    format: str


@dataclass(frozen=True, kw_only=True)
class LaboratoryWords:
    """What a certificate says of the laboratory; what nobody told is empty."""

    name: str = ""
    address: str = ""
    customer: str = ""
    order: str = ""
    method: str = ""
    deviations: str = ""
    place: str = ""
    received: str = ""
    logo: Logo | None = None
    words: Words = ENGLISH
    """The language in which it is said."""


def laboratory_of(path: Path | None) -> LaboratoryWords:
    """The `[laboratory]` of a rig's description with its logo read; empty where there is neither.

    Raises `ConfigurationError` for a file, a logo or a language that cannot be read.
    """
    if path is None or (told := load_laboratory(path)) is None:
        return LaboratoryWords()
    return LaboratoryWords(
        name=told.name,
        address=told.address,
        customer=told.customer,
        order=told.order,
        method=told.method,
        deviations=told.deviations,
        place=told.place,
        received=str(told.received or ""),
        logo=_logo(path, told.logo) if told.logo else None,
        words=words_of(told.language, path.parent),
    )


def _logo(path: Path, name: str) -> Logo:
    where, file = f"{path}: laboratory.logo", path.parent / name
    try:
        content = file.read_bytes()
    except OSError as error:
        raise ConfigurationError(
            "the logo cannot be read",
            where=where,
            value=f"{file}: {error.strerror or error}",
            remedy="Put the picture beside this file, or take the line away.",
        ) from error
    kind = next((word for begin, word in FORMATS.items() if content.startswith(begin)), "")
    if not kind:
        raise ConfigurationError(
            "is no picture that a certificate can show",
            where=where,
            value=str(file),
            limit="PNG, JPEG or SVG",
        )
    if len(content) > _LARGEST_LOGO:
        raise ConfigurationError(
            "the logo is too large",
            where=where,
            value=f"{len(content)} bytes",
            limit=f"{_LARGEST_LOGO} bytes",
            remedy="Make the picture smaller.",
        )
    return Logo(content, kind)

"""How the pages write kinds, defaults and text within tables."""

from __future__ import annotations

import re
import types
import typing
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel

from rig.bench.config.certificate_file import CertificateFile


def arms(annotation: Any) -> Iterable[Any]:
    """The kinds that an annotation is made of."""
    if typing.get_origin(annotation) is typing.Annotated:
        # What follows the kind are its checks.
        yield from arms(typing.get_args(annotation)[0])
    elif typing.get_origin(annotation) in (tuple, typing.Union, types.UnionType):
        for part in typing.get_args(annotation):
            yield from arms(part)
    else:
        yield annotation


def kind_text(annotation: Any) -> str:
    """An annotation as people say it."""
    if typing.get_origin(annotation) is typing.Literal:
        return " or ".join(repr(value) for value in typing.get_args(annotation))
    if typing.get_origin(annotation) is dict:
        return "table"
    words = {
        int: "whole number",
        float: "number",
        str: "text",
        bool: "true or false",
        CertificateFile: "name of a file",
        type(None): "",
        Ellipsis: "",
    }
    found = []
    for kind in arms(annotation):
        if typing.get_origin(kind) is not None:
            found.append(kind_text(kind))
        elif isinstance(kind, type) and issubclass(kind, BaseModel):
            found.append("table")
        else:
            found.append(words.get(kind, getattr(kind, "__name__", str(kind))))
    text = " or ".join(dict.fromkeys(word for word in found if word))
    return f"list of {text}" if typing.get_origin(annotation) is tuple else text


def default_text(value: Any) -> str:
    """A default as it would be typed."""
    if value is None or value == "" or isinstance(value, BaseModel):
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple | list):
        return " ".join(f"{v:g}" if isinstance(v, float) else str(v) for v in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def cell(text: str) -> str:
    """Text that does not break a table: angle brackets and bars are escaped."""
    return re.sub(r"([|<>])", r"\\\1", text.replace("\n", " "))


def plain(text: str) -> str:
    """Help text without the markup of the terminal; words in capitals within brackets stay text."""
    text = re.sub(r"\[/?(bold|italic|dim)\]", "", text)
    return re.sub(r"\[([^\]]*)\](?!\()", r"\\[\1\\]", text).strip()

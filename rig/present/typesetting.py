"""Sets one document on paper with typst, in a process of its own that ends with it.

typst keeps what it has set for the next document of the same process: 300 MB for a certificate. A window, a service
or a campaign, which lives for hours and prints one now and then, would never get them back.

    python -P -m rig.present.typesetting < order > pages

The order is one JSON object (`source`, `content`, `fonts`, `output`). What comes back is a line of JSON, the sizes
of the pages (or of the one document), and then these bytes; or, with exit code 1, the reason.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rig.errors import RigError


@dataclass(frozen=True)
class Document:
    """What is to be set: the source, the content that it shows (JSON), and the folders of its fonts."""

    source: str
    content: str
    fonts: Sequence[str]

    def set_by_typst(self, call: Any, **output: Any) -> Any:
        """What one of typst's functions makes of it, in this process."""
        return call(
            self.source.encode(),
            sys_inputs={"content": self.content},
            ignore_system_fonts=True,
            font_paths=list(self.fonts),
            **output,
        )


def set_pages(document: Document, output: Mapping[str, Any]) -> list[bytes]:
    """The pages of a document in the format that `output` names (a PDF is one of them). Raises `RigError`."""
    order = json.dumps({**asdict(document), "output": dict(output)}).encode()
    command = [sys.executable, "-P", "-m", "rig.present.typesetting"]
    try:
        done = subprocess.run(command, input=order, capture_output=True, check=False)
    except OSError as error:
        raise _not_set(str(error)) from error
    if done.returncode:
        told = done.stdout.decode(errors="replace")
        raise _not_set(told or f"its process ended with {done.returncode}")
    head, _, rest = done.stdout.partition(b"\n")
    pages: list[bytes] = []
    for size in json.loads(head):
        pages.append(rest[:size])
        rest = rest[size:]
    return pages


def _not_set(reason: str) -> RigError:
    return RigError(
        f"the report cannot be set on paper: {reason}", remedy="Write it as HTML instead."
    )


def _serve() -> int:
    """Set the document of standard input on standard output."""
    import typst

    order = json.load(sys.stdin.buffer)
    output = order.pop("output")
    try:
        made = Document(**order).set_by_typst(typst.compile, **output)
    except (RuntimeError, ValueError, OSError) as error:
        sys.stdout.buffer.write(str(error).encode())
        return 1
    pages = made if isinstance(made, list) else [made]
    sys.stdout.buffer.write(json.dumps([len(page) for page in pages]).encode() + b"\n")
    for page in pages:
        sys.stdout.buffer.write(page)
    return 0


if __name__ == "__main__":
    sys.exit(_serve())

"""Parts of a sentence: what stands only where there is something to say, words by their number, texts cut to fit."""

import shlex


def quoted(word: object) -> str:
    """A path or a serial number as it stands in a command: in quotes where a shell would part it."""
    return shlex.quote(str(word))


def phrase(form: str, *parts: object) -> str:
    """A form with these parts in it, as `str.format` sets them; "" where the first of them is empty, None or zero."""
    return form.format(*parts) if parts[0] else ""


def counted(number: int, one: str, several: str) -> str:
    """A number with the word for what is counted: 1 run, 2 runs."""
    return f"{number} {one if number == 1 else several}"


def shortened(text: str, most: int) -> str:
    """A text of no more letters than that; that something is cut off is seen."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def yes_or_no(holds: bool) -> str:
    """The word for what holds or does not, as columns of a table have it."""
    return "yes" if holds else "no"

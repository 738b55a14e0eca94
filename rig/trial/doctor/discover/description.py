"""A proposal as the text of a description: every word with its reason beside it."""

from __future__ import annotations

from model.toml_text import toml_value
from rig.bench.config.load import FORMAT, TO_BE_SAID
from rig.content.phrase import phrase
from rig.trial.doctor.discover.proposal import Proposal, Table, Word

_HEAD = f"""# A description of this rig, proposed from what its nodes tell of themselves. Nothing of it was measured.
# What only you know begins with "{TO_BE_SAID.strip()}": `rig config check` names each until it is said. Check every
# other number against the nameplate; `rig config new` writes a file with every word that may stand here.
"""


def description(proposal: Proposal) -> str:
    """The text of the file."""
    parts = [_HEAD + f'format = "{FORMAT}"\n']
    if proposal.refused:
        refused = "\n".join(f"# - {what}" for what in proposal.refused)
        parts.append(
            "# Not done by this program, and to be set otherwise in the devices first:\n"
            + refused
            + "\n"
        )
    parts += [_table(table) for table in proposal.tables]
    return "\n".join(parts)


def _table(table: Table) -> str:
    return phrase("# {}\n", table.remark) + table.heading + "\n" + "".join(map(_line, table.words))


def _line(word: Word) -> str:
    if word.value is None:
        return f"# {word.name}: {word.why}\n"
    why = "" if word.is_open else f"  # {word.why}"
    return f"{word.name} = {toml_value(word.value)}{why}\n"

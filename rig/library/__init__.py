"""The runs of a folder: their numbers, what each says of itself, and an index that makes a large
folder quick to search.

The files are the truth. `folder.py` gives out numbers and lists the files as they are; `index.py`
keeps what they said in a cache beside them, which may be deleted at any time.
"""

from rig.library.folder import (
    NUMBERS_FOLDER,
    RUN_SUFFIXES,
    ListedRun,
    RunPlace,
    claim_run,
    list_runs,
    read_listed,
    run_files,
    run_number,
)
from rig.library.index import IndexedRun, LibraryIndex

__all__ = [
    "NUMBERS_FOLDER",
    "RUN_SUFFIXES",
    "IndexedRun",
    "LibraryIndex",
    "ListedRun",
    "RunPlace",
    "claim_run",
    "list_runs",
    "read_listed",
    "run_files",
    "run_number",
]

"""Names of result files.

In: the name of a stack and an artifact. Out: a file name without its ending that every system allows.
"""

from __future__ import annotations

import re
from typing import List, Sequence

#: Folder of the small pictures of the contact sheet, which have the names of the stacks.
SHEET_FOLDER = "contact-sheet"
#: Names that Windows reserves for devices.
DEVICES = frozenset({"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(1, 10))})


def safe_name(name: str) -> str:
    """A name that every system allows for a file, and that shells need not quote."""
    text = re.sub(r"[^\w.=+-]+", "_", name).strip("._ ")
    stem = text.split(".")[0].lower()
    return f"_{text}" if stem in DEVICES or not text else text[:120]


def file_stem(name: str, artifact: str) -> str:
    """The file name of an artifact without its ending: ``bee``, ``bee_mask``, ``bee_preview``, ..."""
    return safe_name(name) + ("" if artifact == "image" else f"_{artifact}")


def result_stems(name: str, save: Sequence[str]) -> List[str]:
    """The results of a stack by their paths below the folder of the results, without endings."""
    return [*(file_stem(name, artifact) for artifact in save), f"{SHEET_FOLDER}/{safe_name(name)}"]

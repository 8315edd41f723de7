"""Results beside the stacks."""

from __future__ import annotations

from pathlib import Path
from typing import Any, List, Mapping, Optional, Sequence

from .._client import Client
from .._paths import on_disk
from .names import SHEET_FOLDER, file_stem, safe_name

#: Endings of the file types that the service sends.
SUFFIXES = {"image/png": ".png", "image/tiff": ".tif", "image/jpeg": ".jpg"}


def save_results(client: Client, stack: Mapping[str, Any], name: str, wanted: Sequence[str], to: Path) -> List[Path]:
    """Saves artifacts as ``{name}.png``, ``{name}_mask.png``, ... and a small picture for the contact sheet.

    A file appears when it is complete. An artifact that the stack does not have, such as the mask of one without back
    light, is left out.
    """
    on_disk(to).mkdir(parents=True, exist_ok=True)
    small = to / SHEET_FOLDER
    on_disk(small).mkdir(exist_ok=True)
    saved = [_save(client, stack, artifact, to / file_stem(name, artifact)) for artifact in wanted]
    _save(client, stack, "preview", small / safe_name(name))
    return [path for path in saved if path is not None]


def missing(name: str, wanted: Sequence[str], to: Path) -> List[str]:
    """The artifacts of which no file is there."""

    def is_there(artifact: str) -> bool:
        return any(on_disk(to / f"{file_stem(name, artifact)}{suffix}").exists() for suffix in SUFFIXES.values())

    return [artifact for artifact in wanted if not is_there(artifact)]


def _save(client: Client, stack: Mapping[str, Any], artifact: str, to: Path) -> Optional[Path]:
    """Saves an artifact, if the stack has it; ``to`` is the path of the file without its ending."""
    made = [one for one in stack.get("artifacts", []) if one["name"] == artifact]
    if not made:
        return None
    suffix = SUFFIXES.get(str(made[0]["media_type"]), ".png")
    return client.save_artifact(stack, artifact, to.with_name(to.name + suffix))

"""Which light a folder holds, by its name.

The service knows it too, and says it to ``push`` and ``watch``. This copy is for ``convert``, which needs no service;
a test compares both.
"""

from __future__ import annotations

import unicodedata
from pathlib import PurePath

#: Names of folders with front light, and with back light, in six languages, as :func:`plain` makes them.
_FRONT = (
    "front frontlight frontlit fg foreground withoutbacklight "
    "vorne vordergrund vorderlicht frontlicht auflicht beleuchtet ohnegegenlicht "
    "avant devant lumiereavant eclairageavant sanscontrejour "
    "frente frontal delante luzfrontal sincontraluz "
    "fronte frontale davanti lucefrontale senzacontroluce "
    "voor voorkant voorgrond voorlicht opvallendlicht zondertegenlicht"
)
_BACK = (
    "back backlight backlit bg background withbacklight "
    "hinten hintergrund hintergrundlicht gegenlicht durchlicht rucklicht ruecklicht mitgegenlicht "
    "arriere derriere fond contrejour aveccontrejour lumierearriere eclairagearriere retroeclairage "
    "contraluz concontraluz fondo detras trasera luztrasera retroiluminacion "
    "controluce concontroluce dietro retro sfondo retroilluminazione "
    "achter achterkant achtergrond achterlicht tegenlicht doorvallendlicht"
)
FRONT, BACK = frozenset(_FRONT.split()), frozenset(_BACK.split())


def plain(name: str) -> str:
    """A name in lower case, without blanks, ``_``, ``-`` and accents."""
    letters = unicodedata.normalize("NFKD", name.lower())
    return "".join(letter for letter in letters if letter not in " _-" and not unicodedata.combining(letter))


def is_back(path: PurePath) -> bool:
    """Whether a picture is in a folder of back light."""
    return plain(path.parent.name) in BACK


def stack_of(path: PurePath) -> PurePath:
    """The folder of the stack of a picture: that of the picture, or the one around a folder of a light."""
    return path.parent.parent if plain(path.parent.name) in FRONT | BACK else path.parent

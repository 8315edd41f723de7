"""The contact sheet: an HTML page with a picture and a line per stack. It loads nothing but the small pictures."""

from __future__ import annotations

import html
from pathlib import Path
from typing import List, Sequence

from .._paths import on_disk
from .names import safe_name
from .results import SUFFIXES
from .sender import Outcome

STYLE = """
body { font: 15px system-ui, sans-serif; margin: 1.5rem; color-scheme: light dark; }
ul { display: grid; grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); gap: 1rem; padding: 0; }
li { list-style: none; border: 1px solid #8886; border-radius: 6px; padding: .6rem; }
img { max-width: 100%; height: 10rem; object-fit: contain; display: block; margin: 0 auto .4rem; }
.bad { color: #c62828; font-weight: 600; }
p { margin: .2rem 0; }
"""


def write(outcomes: Sequence[Outcome], results: Path) -> Path:
    """Writes ``contact-sheet.html`` beside the results. Stacks of earlier runs keep their place if they are given."""
    on_disk(results).mkdir(parents=True, exist_ok=True)
    items = "\n".join(_item(outcome, results) for outcome in outcomes)
    page = (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>Contact sheet</title>'
        f"<style>{STYLE}</style><h1>{len(outcomes)} stacks</h1><ul>\n{items}\n</ul></html>\n"
    )
    to = results / "contact-sheet.html"
    part = results / "contact-sheet.html.part"
    on_disk(part).write_text(page, "utf-8", errors="backslashreplace")
    on_disk(part).replace(on_disk(to))
    return to


def _item(outcome: Outcome, results: Path) -> str:
    lines: List[str] = []
    names = [f"{safe_name(outcome.name)}{suffix}" for suffix in SUFFIXES.values()]
    pictures = [name for name in names if on_disk(results / "contact-sheet" / name).exists()]
    if pictures:
        lines.append(f'<img src="contact-sheet/{html.escape(pictures[0])}" alt="" loading="lazy">')
    lines.append(f"<b>{html.escape(outcome.name)}</b>")
    if not outcome.is_good:
        lines.append(f'<p class="bad">{html.escape(outcome.state)}</p>')
    metrics = (outcome.stack or {}).get("metrics") or {}
    retention = (metrics.get("fusion") or {}).get("sharpness_retention")
    residual = (metrics.get("alignment") or {}).get("residual_p95_px")
    figures = [f"sharpness {retention:.2f}"] if retention is not None else []
    figures += [f"residual {residual:.2f} px"] if residual is not None else []
    if figures:
        lines.append(f"<p>{', '.join(figures)}</p>")
    lines.extend(f"<p>{html.escape(sentence)}</p>" for sentence in outcome.sentences)
    return f"<li>{''.join(lines)}</li>"

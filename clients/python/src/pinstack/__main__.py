"""``python -m pinstack``."""

from .push.cli import run

run()

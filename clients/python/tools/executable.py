"""Where the program of ``pinstack.spec`` begins: PyInstaller starts a script, not a module of a package."""

from pinstack.push.cli import run

run()

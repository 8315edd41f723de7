#!/usr/bin/env python3
"""Writes the licence texts of all crates in the binary for a target: scripts/release/notices.py TARGET OUT.

Permissive licences ask that their text goes with a binary. The texts come from the sources of the crates, which Cargo
has downloaded. OUT receives one text file; equal texts are written once, with the crates that they belong to.
"""

from __future__ import annotations

import json
import pathlib
import re
import subprocess
import sys
from collections import defaultdict

LICENCE = re.compile(r"(?i)^(un)?licen[cs]e|^copying|^notice|^copyright")
RULE = "-" * 80


def crates(target: str) -> list[dict]:
    """The packages that are linked into the binary: neither build scripts' nor tests' dependencies."""
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", target]
    metadata = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    packages = {package["id"]: package for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    found, waiting = set(), [metadata["resolve"]["root"]]
    while waiting:
        one = waiting.pop()
        if one in found:
            continue
        found.add(one)
        for dependency in nodes[one]["deps"]:
            if any(kind["kind"] is None for kind in dependency["dep_kinds"]):
                waiting.append(dependency["pkg"])
    # a package without a source is one of this project
    linked = [packages[one] for one in found if packages[one]["source"] is not None]
    return sorted(linked, key=lambda package: (package["name"], package["version"]))


def texts(package: dict) -> list[str]:
    folder = pathlib.Path(package["manifest_path"]).parent
    files = {path for path in folder.iterdir() if LICENCE.match(path.name) and path.is_file()}
    if package["license_file"]:
        files.add(folder / package["license_file"])
    for folder in (folder / name for name in ("LICENSES", "licenses")):
        if folder.is_dir():
            files.update(path for path in folder.iterdir() if path.is_file())
    return [path.read_text(encoding="utf-8", errors="replace").strip() for path in sorted(files)]


def main() -> int:
    if len(sys.argv) != 3:
        print("usage: scripts/release/notices.py TARGET OUT", file=sys.stderr)
        return 2
    target, out = sys.argv[1:]
    owners: dict[str, list[str]] = defaultdict(list)
    shown: dict[str, str] = {}
    without = []
    for package in crates(target):
        name = f"{package['name']} {package['version']} ({package['license'] or 'see its text'})"
        found = texts(package)
        for text in found:
            # the same text with other line breaks is the same text
            key = " ".join(text.split())
            shown.setdefault(key, text)
            owners[key].append(name)
        if not found:
            without.append(f"{name} {package['repository'] or ''}".rstrip())
    lines = ["pinstack contains the following software of others, under the licences below.", ""]
    for key, names in sorted(owners.items(), key=lambda item: (-len(item[1]), item[1])):
        lines += [RULE, *sorted(set(names)), "", shown[key], ""]
    if without:
        lines += [RULE, "The packages of these crates contain no licence text:", "", *without, ""]
    pathlib.Path(out).write_text("\n".join(lines), encoding="utf-8")
    total = len({name for names in owners.values() for name in names}) + len(without)
    print(f"{out}: {total} crates, {len(owners)} texts, {len(without)} crates without a text")
    return 0


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
"""Writes the licence texts of everything in the binary for a target: scripts/release/notices.py TARGET OUT.

Permissive licences ask that their text goes with a binary. In: the sources of the crates, which Cargo has downloaded,
those of Swagger UI in one of them, the notices of the Rust toolchain, and for musl those of zig, which
scripts/release/tools.sh installs. Out: one text file; equal texts are written once, with all that they belong to.
"""

from __future__ import annotations

import html.parser
import json
import os
import pathlib
import re
import subprocess
import sys
import zipfile
from collections import defaultdict
from typing import Iterator

LICENCE = re.compile(r"(?i)^(un)?licen[cs]e|^copying|^notice|^copyright")
#: Endings of sources, which may be called ``license.rs``.
SOURCES = frozenset({".rs", ".c", ".h", ".py", ".js", ".sh"})
#: Folders of a crate that are not compiled into a binary.
OF_TESTS = frozenset({"tests", "test", "examples", "benches", "fuzz", "doc", "docs"})
RULE = "-" * 80
#: A crate that a build script reads: the page of the API is in the binary.
SWAGGER_UI = "utoipa-swagger-ui-vendored"

#: What a text belongs to, and the text.
Notice = tuple[str, str]


def crates(target: str) -> tuple[list[dict], dict]:
    """The packages that are linked into the binary, neither build scripts' nor tests' dependencies; and Swagger UI."""
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
    (swagger_ui,) = (package for package in packages.values() if package["name"] == SWAGGER_UI)
    return sorted(linked, key=lambda package: (package["name"], package["version"])), swagger_ui


def texts(package: dict) -> list[str]:
    """The licence texts in a crate, also those of the C that it brings along."""
    crate = pathlib.Path(package["manifest_path"]).parent
    named = {path for path in crate.rglob("*") if LICENCE.match(path.name) and path.suffix not in SOURCES}
    for folder in ("LICENSES", "licenses"):
        named.update(crate.glob(f"{folder}/*"))
    files = {path for path in named if path.is_file() and OF_TESTS.isdisjoint(path.relative_to(crate).parts)}
    if package["license_file"]:
        files.add(crate / package["license_file"])
    return [path.read_text(encoding="utf-8", errors="replace").strip() for path in sorted(files)]


def of_swagger_ui(package: dict) -> Iterator[Notice]:
    """Licence and notice of the archive in the crate."""
    (archive,) = (pathlib.Path(package["manifest_path"]).parent / "res").glob("*.zip")
    with zipfile.ZipFile(archive) as files:
        for name in ("LICENSE", "NOTICE"):
            (member,) = (one for one in files.namelist() if re.fullmatch(rf"[^/]+/{name}", one))
            yield f"Swagger UI {archive.stem} (Apache-2.0)", files.read(member).decode().strip()


class _Text(html.parser.HTMLParser):
    """The text of a page, without its head."""

    def __init__(self) -> None:
        super().__init__()
        self.lines = [""]
        self.is_shown = True

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.is_shown = self.is_shown and tag != "head"

    def handle_endtag(self, tag: str) -> None:
        self.is_shown = self.is_shown or tag == "head"

    def handle_data(self, data: str) -> None:
        if self.is_shown:
            first, *more = data.split("\n")
            self.lines[-1] += first
            self.lines += more


def of_rust() -> Iterator[Notice]:
    """The notices of the standard library and of what is in it."""
    ask = ["rustc", "--print", "sysroot"]
    root = pathlib.Path(subprocess.run(ask, check=True, stdout=subprocess.PIPE, text=True).stdout.strip())
    version = subprocess.run(["rustc", "--version"], check=True, stdout=subprocess.PIPE, text=True).stdout.split()[1]
    page = _Text()
    page.feed((root / "share/doc/rust/COPYRIGHT-library.html").read_text(encoding="utf-8"))
    # the page has an empty line for each part that an entry lacks
    text = re.sub(r"\n\s*\n\s*\n+", "\n\n", "\n".join(line.rstrip() for line in page.lines))
    yield f"Rust standard library {version} (MIT OR Apache-2.0)", text.strip()


def of_musl() -> Iterator[Notice]:
    """The C library, the unwinder and the helpers of the compiler in a static binary."""
    tools = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", "target")) / "release-tools"
    found = list(tools.glob("lib/python*/site-packages/ziglang"))
    if len(found) != 1:
        raise SystemExit(f"{tools} has no zig; run scripts/release/tools.sh with this target")
    for name, file in (
        ("musl (MIT)", "lib/libc/musl/COPYRIGHT"),
        ("libunwind (Apache-2.0 WITH LLVM-exception)", "lib/libunwind/LICENSE.TXT"),
        ("compiler-rt of zig (MIT)", "LICENSE"),
    ):
        yield name, (found[0] / file).read_text(encoding="utf-8").strip()


def main() -> int:
    if len(sys.argv) != 3:
        print("usage: scripts/release/notices.py TARGET OUT", file=sys.stderr)
        return 2
    target, out = sys.argv[1:]
    linked, swagger_ui = crates(target)
    notices: list[Notice] = [*of_rust(), *of_swagger_ui(swagger_ui)]
    if target.endswith("-musl"):
        notices += of_musl()
    without = []
    for package in linked:
        name = f"{package['name']} {package['version']} ({package['license'] or 'see its text'})"
        found = texts(package)
        notices += [(name, text) for text in found]
        if not found:
            without.append(f"{name} {package['repository'] or ''}".rstrip())
    owners: dict[str, list[str]] = defaultdict(list)
    shown: dict[str, str] = {}
    for name, text in notices:
        # the same text with other line breaks is the same text
        key = " ".join(text.split())
        shown.setdefault(key, text)
        owners[key].append(name)
    lines = ["pinstack contains the following software of others, under the licences below.", ""]
    for key, names in sorted(owners.items(), key=lambda item: (-len(item[1]), item[1])):
        lines += [RULE, *sorted(set(names)), "", shown[key], ""]
    if without:
        lines += [RULE, "The packages of these crates contain no licence text; the licences they name are above:", ""]
        lines += [*without, ""]
    pathlib.Path(out).write_text("\n".join(lines), encoding="utf-8")
    print(f"{out}: {len(linked)} crates, {len(owners)} texts, {len(without)} crates without a text")
    return 0


if __name__ == "__main__":
    sys.exit(main())

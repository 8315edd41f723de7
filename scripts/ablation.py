#!/usr/bin/env python3
"""What half and double of each constant do to quality.

    scripts/ablation.py [NAME ...] [--all-stacks]

prints, for each floating-point constant of `fusion/halo_corrected` and `fusion/height` (or for the named ones), the
change of the benches' figures when the constant has half of its value and when it has twice its value. The tables of
docs/method/CONSTANTS.md are its output.

The tracked files are copied to target/ablation. In the copy, each use of a constant is multiplied by a factor that an
environment variable gives. So the benches are built once, and the code itself has no switch for this.
"""

import argparse
import os
import pathlib
import re
import statistics
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
COPY = ROOT / "target" / "ablation"
FOLDERS = ["halo_corrected", "height"]
CONSTANT = re.compile(r"^(\s*)(?:pub(?:\(\w+\))? )?const ([A-Z_0-9]+): (f32|f64) = (.*);$")
VARIABLE = "PINSTACK_ABLATION"

MODULE = f"""
/// The factor of a constant, by the environment.
pub fn factor(name: &str) -> f64 {{
    match std::env::var("{VARIABLE}").unwrap_or_default().split_once('=') {{
        Some((of, factor)) if of == name => factor.parse().expect("a factor"),
        _ => 1.0,
    }}
}}
"""


def constants():
    """(file below `fusion`, name, type, value as written) of each constant."""
    for folder in FOLDERS:
        for file in sorted((ROOT / "science/src/fusion" / folder).rglob("*.rs")):
            if "tests" in file.parts or file.name == "tests.rs":
                continue
            for line in file.read_text().splitlines():
                if found := CONSTANT.match(line):
                    yield file.relative_to(ROOT / "science/src/fusion"), *found.groups()[1:]


def key(file, name):
    """The name by which a constant is chosen: folder or file, and name."""
    return f"{file.with_suffix('')}::{name}".replace("/mod::", "::")


def substituted(text, names):
    """The source with each use of the constants multiplied by their factor. `names`: name -> (key, type)."""
    uses = re.compile(r"(?<![\w:])(" + "|".join(names) + r")(?![\w(])(?!::)")

    def use(found):
        chosen, kind = names[found[1]]
        return (
            f"{{ static X: std::sync::LazyLock<{kind}> = std::sync::LazyLock::new(|| {found[1]} * "
            f'crate::ablation::factor("{chosen}") as {kind}); *X }}'
        )

    lines = []
    for line in text.splitlines():
        code, comment, rest = line.partition("//")
        if not re.match(r"\s*(pub(\(\w+\))? )?(const|use|static) ", code):
            code = uses.sub(use, code)
        lines.append(code + comment + rest)
    return "\n".join(lines) + "\n"


def written(name, text, listed):
    """The text of a tracked file in the copy."""
    path = pathlib.PurePath(name)
    if name == "science/src/lib.rs":
        return text + "\n/// Factors of constants.\npub mod ablation;\n"
    if path.suffix != ".rs" or not any(path.is_relative_to(f"science/src/fusion/{folder}") for folder in FOLDERS):
        return text
    file = path.relative_to("science/src/fusion")
    here = {}
    for of, constant, kind, _ in listed:
        imported = re.search(rf"^use .*\b{constant}\b|^    .*\b{constant}\b,", text, re.M)
        if of == file or imported and constant not in here:
            here[constant] = (key(of, constant), kind)
    return substituted(text, here) if here else text


def copy(listed):
    """Copies the tracked files; what is there already is left, so that it is not built again."""
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    files = {name: (ROOT / name).read_bytes() for name in tracked.split("\0") if (ROOT / name).is_file()}
    files = {
        name: written(name, data.decode(), listed).encode() if name.endswith(".rs") else data
        for name, data in files.items()
    }
    files["science/src/ablation.rs"] = ("//! Factors of constants.\n" + MODULE).encode()
    for name, data in files.items():
        to = COPY / "source" / name
        if not to.is_file() or to.read_bytes() != data:
            to.parent.mkdir(parents=True, exist_ok=True)
            to.write_bytes(data)


def build():
    """The executables of the benches."""
    command = ["cargo", "bench", "--no-run", "--target-dir", COPY / "build"]
    command += ["--bench", "fusion_quality", "--bench", "height"]
    ran = subprocess.run(command, cwd=COPY / "source/science", stderr=subprocess.PIPE, text=True)
    if ran.returncode:
        sys.exit(ran.stderr)
    return {name: path for name, path in re.findall(r"benches/(\w+)\.rs \((.*)\)", ran.stderr)}


def run(program, arguments, chosen="", factor=1.0):
    environment = dict(os.environ, **{VARIABLE: f"{chosen}={factor}"})
    command = [program, "--bench", *arguments]
    ran = subprocess.run(command, cwd=COPY / "source/science", env=environment, capture_output=True, text=True)
    return ran.stdout if ran.returncode == 0 else ""


def quality(programs, file, quick, chosen="", factor=1.0):
    """(figures by column, object edges by scene) of the bench that a constant belongs to."""
    if file.parts[0] == "height":
        out = run(programs["height"], ["--method", "halo_corrected", *quick], chosen, factor)
        found = {}
        for region, *cells in re.findall(r"\| (textured|plain|near steps) \| ([\d.]+) \| ([\d.]+) \|.*\| ([\d.]+) \|$", out, re.M):
            for column, cell in zip(("index", "height", "sigmas"), cells):
                found.setdefault((region, column), []).append(float(cell))
        return {name: statistics.fmean(values) for name, values in found.items()}, {}
    unknown = ["--unknown-near-end"] if file.stem == "depth_order" else []
    out = run(programs["fusion_quality"], ["--method", "halo_corrected", *unknown, *quick], chosen, factor)
    rows = re.findall(r"### (.*?)\n.*?\| halo_corrected \|([^\n]*)\|\n", out, re.S)
    scenes = {scene: [float(cell) for cell in cells.split("|")] for scene, cells in rows}
    whole, _, interior, _, edges, _ = scenes.pop("All scenes", [float("nan")] * 6)
    return {"whole": whole, "interior": interior, "object edges": edges}, {name: row[4] for name, row in scenes.items()}


def change(now, before):
    """The cell of the table: what a factor changed."""
    (figures, scenes), (of, scenes_before) = now, before
    if not figures or set(figures) != set(of):
        return "no result"
    if ("plain", "height") in figures:
        by = [100 * (figures[region, "height"] / of[region, "height"] - 1) for region in ("textured", "plain", "near steps")]
        sigmas = figures["textured", "sigmas"] / of["textured", "sigmas"]
        return ", ".join(f"{value:+.0f}" for value in by) + f"; {sigmas:.2f}"
    worst = min(scenes, key=lambda scene: scenes[scene] - scenes_before[scene])
    cell = ", ".join(f"{figures[column] - of[column]:+.2f}" for column in ("whole", "object edges"))
    lost = scenes[worst] - scenes_before[worst]
    return f"{cell}; {worst} {lost:+.2f}" if lost < -0.01 else cell


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="a constant, such as height/map::MAX_SIGMA")
    parser.add_argument("--all-stacks", action="store_true", help="all stacks of the benches instead of one per scene")
    arguments = parser.parse_args()
    listed = list(constants())
    copy(listed)
    programs = build()
    quick = [] if arguments.all_stacks else ["--quick"]
    before = {}
    for file, name, _, value in listed:
        chosen = key(file, name)
        if arguments.names and chosen not in arguments.names:
            continue
        kind = (file.parts[0], file.stem == "depth_order")
        before[kind] = before.get(kind) or quality(programs, file, quick)
        half, double = (change(quality(programs, file, quick, chosen, factor), before[kind]) for factor in (0.5, 2.0))
        print(f"| `{chosen}` | {value} | {half} | {double} |", flush=True)


if __name__ == "__main__":
    main()

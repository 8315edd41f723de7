"""The program that ``pinstack.spec`` makes, with a running service."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import Service, binary

from pinstack import Client, __version__

FOLDER = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    binary()
    assert importlib.util.find_spec("PyInstaller"), "PyInstaller is not installed"
    folder = tmp_path_factory.mktemp("program")
    command = [sys.executable, "-m", "PyInstaller", "--distpath", folder, "--workpath", folder / "build"]
    made = subprocess.run([*command, "pinstack.spec"], cwd=FOLDER, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    return folder / "pinstack"


def run(program: Path, *arguments: str) -> str:
    # without the Python of the tests, as on a capture PC
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(program.parent)}
    done = subprocess.run([program, *arguments], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, f"{done.stdout}{done.stderr}"
    return done.stdout


def test_it_knows_its_version(program: Path) -> None:
    assert run(program, "--version") == f"pinstack {__version__}\n"


def test_it_pushes_a_folder_and_saves_the_results(program: Path, service: Service, zips: Path, tmp_path: Path) -> None:
    with Client(service.url) as client:
        client.calibrate("capture-pc", "macro65", zips / "target.zip", focal_mm=65.0, pixel_pitch_mm=0.02)
    shots = tmp_path / "shots"
    shutil.copytree(zips / "stack", shots / "view")
    common = ["--server", service.url, "--rig", "capture-pc", "--lens", "macro65", "--quiet-s", "0.1"]
    assert "view" in run(program, "push", str(shots), *common, "--dry-run")
    run(program, "push", str(shots), *common)
    results = shots / "results"
    assert (results / "view.png").read_bytes().startswith(b"\x89PNG")
    assert (results / "contact-sheet.html").exists()

"""The examples of the documents run as they are written."""

from __future__ import annotations

import re
import runpy
import shutil
import zipfile
from pathlib import Path
from typing import Any, Dict

import pytest
from conftest import PROJECT, Service

pytest.importorskip("numpy")
pytest.importorskip("tifffile")
pytest.importorskip("pandas")

HERE = PROJECT / "clients" / "python"


@pytest.fixture
def folder(zips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files that the examples name, and a service of its own at ``PINSTACK_URL``."""
    for name in ("target.zip", "stack.zip"):
        shutil.copy(zips / name, tmp_path)
    for name in ("stack", "views/pan000_tilt15", "views/pan020_tilt15"):
        with zipfile.ZipFile(zips / "stack.zip") as stack:
            stack.extractall(tmp_path / name)
    # what COLMAP wrote
    model = tmp_path / "model/0"
    model.mkdir(parents=True)
    lines = [f"{at} 1 0 0 0 {at} 2 3 1 pan0{at - 1}0_tilt15.png\n\n" for at in (1, 3)]
    (model / "images.txt").write_text("".join(lines), "utf-8")
    (model / "cameras.txt").write_text("1 SIMPLE_PINHOLE 810 540 2712.5 405 270\n", "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_blocks(document: Path, url: str) -> Dict[str, Any]:
    text = document.read_text(encoding="utf-8").replace("http://127.0.0.1:8080", url)
    blocks = re.findall(r"^```python\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
    assert blocks, document
    names: Dict[str, Any] = {}
    for block in blocks:
        exec(compile(block, str(document), "exec"), names)
    return names


@pytest.fixture
def own_service(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    (folder / "service").mkdir()
    service = Service(folder / "service")
    monkeypatch.setenv("PINSTACK_URL", service.url)
    yield service
    service.kill()


def test_the_examples_of_the_page_run(folder: Path, own_service: Service) -> None:
    names = run_blocks(PROJECT / "docs" / "PYTHON.md", own_service.url)
    assert names["mask"].shape == names["depth"].shape == names["height"].shape == names["image"].shape[:2]
    assert list(names["table"]["pan_deg"]) == [0, 20] and names["residual"] < 1
    assert (folder / "beetle.tif").stat().st_size > (folder / "beetle.png").stat().st_size > 0
    assert zipfile.is_zipfile(folder / "beetle-colmap.zip")


def test_the_example_of_the_readme_runs(folder: Path, own_service: Service) -> None:
    run_blocks(HERE / "README.md", own_service.url)
    assert (folder / "beetle.png").stat().st_size > 0


def test_the_session_runs(folder: Path, own_service: Service, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.rmtree(folder / "views")
    runpy.run_path(str(HERE / "examples" / "session.py"))
    told = capsys.readouterr().out
    assert "profile_not_found - " in told and "pan020_tilt15" in told
    assert zipfile.is_zipfile(folder / "beetle-colmap.zip")

"""A service for the tests that need one: the binary in ``PINSTACK_TEST_BINARY``.

Without the binary they are skipped.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from typing import Iterator, List, Optional

import httpx
import pytest

from pinstack import Client, Retry

PROJECT = Path(__file__).resolve().parents[3]


def binary() -> str:
    """The path of the binary under test."""
    path = os.environ.get("PINSTACK_TEST_BINARY")
    if path is None:
        pytest.skip("PINSTACK_TEST_BINARY is not set")
    return path


def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that exists for calls alone, as a long path of Windows does: a call by the path itself finds nothing."""
    root, disk = tmp_path / "shown", tmp_path / "disk"
    disk.mkdir()

    def on_disk(path: Path) -> Path:
        return disk / path.relative_to(root) if path == root or root in path.parents else path

    for name, module in list(sys.modules.items()):
        if name.split(".")[0] == "pinstack" and hasattr(module, "on_disk"):
            monkeypatch.setattr(module, "on_disk", on_disk)
    return root


class Service:
    """A running ``pinstack serve`` on a port of its own."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"127.0.0.1:{free.getsockname()[1]}"
        self.folder = folder
        self.arguments: List[str] = list(arguments)
        self.process: Optional[subprocess.Popen[bytes]] = None
        self.start()

    @property
    def url(self) -> str:
        return f"http://{self.address}"

    def start(self) -> None:
        data = str(self.folder / "data")
        command = [binary(), "serve", "--listen", self.address, "--data-dir", data, *self.arguments]
        with (self.folder / "log").open("ab") as log:
            self.process = subprocess.Popen(command, stdout=log, stderr=log)
        while True:
            assert self.process.poll() is None, (self.folder / "log").read_text()
            try:
                httpx.get(f"{self.url}/healthz")
                return
            except httpx.TransportError:
                time.sleep(0.01)

    def kill(self) -> None:
        """``kill -9``."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()


@pytest.fixture(scope="session")
def zips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``target.zip`` and ``stack.zip``, and the stack unpacked in ``stack``."""
    folder = tmp_path_factory.mktemp("demo")
    command = [binary(), "demo", "--width", "420", "--slices", "5", "--out", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    with zipfile.ZipFile(folder / "stack.zip") as stack:
        stack.extractall(folder / "stack")
    return folder


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    running = Service(tmp_path_factory.mktemp("service"))
    yield running
    running.kill()


@pytest.fixture
def client(service: Service) -> Iterator[Client]:
    with Client(service.url, retry=Retry(first_s=0.01)) as client:
        yield client

"""What the client sends is what the OpenAPI document describes, and what is generated is up to date."""

from __future__ import annotations

import base64
import importlib.util
import inspect
import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any, Callable, Dict, Iterator, List, Tuple

import httpx
import pytest
from conftest import PROJECT
from fake import JOB, UPLOAD

from pinstack import AsyncClient, Client, Retry

HERE = PROJECT / "clients" / "python"
ID = "0190b1a6-0000-7000-8000-000000000000"
ZIP = b"PK\5\6" + b"\0" * 18
PROFILE = {"image_width": 6, "image_height": 4, "reference_index": 0, "homographies": [[1, 0, 0, 0, 1, 0, 0, 0, 1]]}


@pytest.fixture(scope="module")
def document() -> Any:
    return json.loads((PROJECT / "openapi" / "openapi.json").read_text(encoding="utf-8"))


def tool(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"tool_{name}", HERE / "tools" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_models_are_those_of_the_document(document: Any) -> None:
    written = (HERE / "src/pinstack/models.py").read_text(encoding="utf-8")
    command = "cd clients/python && python tools/models.py ../../openapi/openapi.json > src/pinstack/models.py"
    assert tool("models").module(document) == written, f"run: {command}"


def test_the_asynchronous_client_is_that_of_the_blocking_one() -> None:
    text = (HERE / "src/pinstack/_client.py").read_text(encoding="utf-8")
    written = (HERE / "src/pinstack/_async_client.py").read_text(encoding="utf-8")
    command = "cd clients/python && python tools/async_client.py > src/pinstack/_async_client.py"
    assert tool("async_client").asynchronous(text) == written, f"run: {command}"
    for name, method in inspect.getmembers(Client, inspect.isfunction):
        if not name.startswith("_"):
            twin = getattr(AsyncClient, name)
            assert inspect.iscoroutinefunction(twin), name
            assert inspect.signature(twin) == inspect.signature(method), name


class Recorder:
    """Answers everything with something that fits, and keeps the requests."""

    def __init__(self) -> None:
        self.requests: List[httpx.Request] = []

    def __call__(self, request: httpx.Request) -> httpx.Response:
        request.read()
        self.requests.append(request)
        path = request.url.path
        if path.endswith("/events"):
            return httpx.Response(204, stream=httpx.ByteStream(b""))
        if path.startswith("/v1/uploads"):
            headers = {"location": UPLOAD, "upload-offset": "22", "upload-length": "22", "pinstack-job": JOB}
            return httpx.Response(201, headers=headers)
        if path.endswith((".csv", "/export", "/report", "/image", "/mask", "/bundle", "/upload")):
            return httpx.Response(200, headers={"etag": '"a"'}, stream=httpx.ByteStream(b"name,label\na,01\n"))
        answer = {
            "id": ID, "items": [], "next_cursor": None, "views": [{"stack": JOB, "name": "a"}],
            "state": "succeeded", **PROFILE,
        }  # fmt: skip
        return httpx.Response(200, json=answer)


def calls(client: Client, folder: Path) -> Dict[str, Callable[[], Any]]:
    """A call of every public method with every kind of argument that changes the request."""
    return {
        "info": client.info,
        "list_profiles": lambda: client.list_profiles("rig", "lens"),
        "list_revisions": lambda: client.list_revisions("rig", "lens"),
        "get_profile": lambda: client.get_profile("rig", "lens", 3),
        "put_profile": lambda: client.put_profile("rig", "lens", PROFILE, if_match='"1"'),
        "delete_profile": lambda: client.delete_profile("rig", "lens"),
        "export_profile": lambda: client.export_profile("rig", "lens", format="npz", revision=2),
        "homographies": lambda: client.homographies("rig", "lens", 2),
        "calibrate": lambda: (
            client.calibrate("rig", "lens", ZIP, focal_mm=65),
            client.calibrate("rig", "lens", stacks=[ID, JOB], rail_step_mm=0.5),
            client.calibrate("rig", "lens", scan="s", from_revision=3),
        ),
        "list_calibrations": lambda: client.list_calibrations(rig="rig", lens="lens", state="failed"),
        "get_calibration": lambda: client.get_calibration(ID),
        "calibration_report": lambda: client.calibration_report(ID),
        "send_stack": lambda: (
            client.send_stack(ZIP, "rig", "lens", label="a"),
            client.send_stack(ZIP, "rig", "lens", resume=f"/v1/uploads/{ID}"),
            client.send_stack(ZIP, "rig", "lens", idempotency_key="k", label="a", scan="s", pan_deg=1, tilt_deg=-2.5),
        ),
        "fuse": lambda: client.fuse(ZIP, "rig", "lens", method="guided"),
        "wait": lambda: client.wait(f"/v1/calibrations/{ID}"),
        "list_stacks": lambda: client.list_stacks(rig="rig", lens="lens", scan="s", state="queued"),
        "count_stacks": lambda: client.count_stacks(rig="rig", lens="lens", scan="s", q="bee", since="2026-11-27"),
        "get_stack": lambda: client.get_stack(ID),
        "metrics": lambda: client.metrics(ID),
        "rerun_stack": lambda: client.rerun_stack(ID, method="pyramid", mask="none"),
        "cancel": lambda: (client.cancel(ID), client.cancel(f"/v1/calibrations/{ID}")),
        "delete": lambda: (client.delete(ID), client.delete(f"/v1/calibrations/{ID}")),
        "artifact": lambda: client.artifact(ID, "image", accept="image/tiff"),
        "save_artifact": lambda: client.save_artifact(ID, "mask", folder / "mask.png"),
        "save_upload": lambda: client.save_upload(ID, folder / "sent.zip"),
        "list_scans": lambda: client.list_scans(rig="rig", lens="lens"),
        "put_scan": lambda: client.put_scan("s", "rig", "l", expected_views=2, reconstruct="auto", metadata={"a": "b"}),
        "get_scan": lambda: client.get_scan("s"),
        "delete_scan": lambda: client.delete_scan("s", with_stacks=True),
        "group": lambda: client.group("s", ZIP, x="pan", x_degrees_per_unit=0.1, y_zero=3),
        "group_names": lambda: client.group_names(["a/1.jpg"], {"views": []}, x="pan", y_zero=1),
        "send_scan": lambda: (client.send_scan("s", ZIP), client.send_scan("s", ZIP, x_degrees_per_unit=0.1)),
        "wait_scan": lambda: client.wait_scan("s"),
        "rerun_scan": lambda: client.rerun_scan("s", method="guided"),
        "save_bundle": lambda: client.save_bundle("s", "colmap", folder / "bundle.zip", partial=True),
        "start_reconstruction": lambda: client.start_reconstruction("s", partial=True, max_error_px=2.0),
        "reconstruct": lambda: client.reconstruct("s", partial=True),
        "list_reconstructions": lambda: client.list_reconstructions("s"),
        "get_reconstruction": lambda: client.get_reconstruction(ID),
        "poses": lambda: (
            client.poses(b"name,x,y,z\n", file_format="csv", expected=2, radius_mm=140.0),
            client.poses(b"name,x,y,z\n", scan="s", pair_from="a", pair_to="b", pair_mm=1.5),
            client.poses(b"name,x,y,z\n", length_from=(0, 0.5, 1), length_to=[1, 2, -3], length_mm=1.5),
        ),
        "list_notes": lambda: (client.list_notes(ID), client.list_notes(profile=("rig", "lens"))),
        "add_note": lambda: (client.add_note("a", ID), client.add_note("b", scan="s")),
        "delete_note": lambda: client.delete_note(ID, scan="s"),
        "request": lambda: client.request("GET", "/v1/profiles/rig/lens/drift", query={"from": "1"}),
    }


#: Methods whose results need libraries, and which send what another method sends.
SAME_AS_ANOTHER = {"image", "mask", "depth", "light", "height", "height_sigma", "scan_table", "url", "close"}


def operation(document: Any, request: httpx.Request) -> Tuple[str, Any]:
    """The operation of the document that a request is for."""
    for template, methods in document["paths"].items():
        pattern = re.sub(r"\\{[a-z_]+\\}", "[^/]+", re.escape(template))
        if re.fullmatch(pattern, request.url.path) and request.method.lower() in methods:
            return template, methods[request.method.lower()]
    raise AssertionError(f"the document has no {request.method} {request.url.path}")


def resolve(document: Any, schema: Any) -> Any:
    while "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rsplit("/", 1)[1]]
    return schema


def properties(document: Any, schema: Any) -> Iterator[str]:
    schema = resolve(document, schema)
    yield from schema.get("properties", {})
    for part in schema.get("allOf", []):
        yield from properties(document, part)


#: Headers that every request has, or that HTTP itself defines.
COMMON = {"host", "accept", "accept-encoding", "connection", "user-agent", "content-type", "content-length", "if-match"}


def check(document: Any, request: httpx.Request) -> None:
    template, described = operation(document, request)
    what = f"{request.method} {template}"
    parameters = described.get("parameters", [])
    known = {parameter["name"] for parameter in parameters if parameter["in"] == "query"}
    assert set(request.url.params) <= known, what
    required = {parameter["name"] for parameter in parameters if parameter["in"] == "query" and parameter["required"]}
    assert required <= set(request.url.params), what
    headers = {parameter["name"].lower() for parameter in parameters if parameter["in"] == "header"}
    assert set(request.headers) - COMMON <= headers, what
    if "if-match" in request.headers:
        assert "if-match" in headers, what
    content = dict(described.get("requestBody", {}).get("content", {}))
    if "x-json-body" in described:
        content["application/json"] = {"schema": described["x-json-body"]}
    media_type = request.headers.get("content-type")
    assert media_type is None or media_type in content or request.content in (b"", b"{}"), what
    if media_type == "application/json" and request.content != b"{}":
        sent = json.loads(request.content)
        schema = content[media_type]["schema"]
        assert set(sent) <= set(properties(document, schema)), what
        assert set(resolve(document, schema).get("required", [])) <= set(sent), what
    accept = request.headers["accept"]
    if accept != "*/*":
        assert any(accept in response.get("content", {}) for response in described["responses"].values()), what


def test_every_call_is_one_of_the_document(document: Any, tmp_path: Path) -> None:
    recorder = Recorder()
    client = Client("http://rig", retry=Retry(attempts=1), transport=httpx.MockTransport(recorder))
    made = calls(client, tmp_path)
    public = {name for name in dir(Client) if not name.startswith("_")}
    assert set(made) | SAME_AS_ANOTHER == public, "a method is not tested here"
    for name, call in made.items():
        before = len(recorder.requests)
        call()
        assert len(recorder.requests) > before, name
    for request in recorder.requests:
        check(document, request)


def test_what_an_upload_says_is_known(document: Any, tmp_path: Path) -> None:
    recorder = Recorder()
    client = Client("http://rig", retry=Retry(attempts=1), transport=httpx.MockTransport(recorder))
    for name in ("calibrate", "send_stack", "fuse", "send_scan"):
        calls(client, tmp_path)[name]()
    options = {"stack": "StackOptionsInput", "calibration": "CalibrationOptions", "scan": "StackOptionsInput"}
    purposes = document["components"]["schemas"]["UploadPurpose"]["enum"]
    described = document["paths"]["/v1/uploads"]["post"]["parameters"]
    about = next(one["description"] for one in described if one["name"] == "Upload-Metadata")
    seen = set()
    for request in recorder.requests:
        if "upload-metadata" not in request.headers:
            continue
        pairs = (pair.split(" ") for pair in request.headers["upload-metadata"].split(","))
        told = {name: base64.b64decode(value).decode() for name, value in pairs}
        assert set(told) <= set(re.findall(r"[a-z_]+", about)), told
        purpose = told.get("purpose", "stack")
        assert purpose in purposes
        assert set(json.loads(told["options"])) <= set(properties(document, schema_of(options[purpose])))
        seen.add(purpose)
    assert seen == set(options)


def schema_of(name: str) -> Dict[str, str]:
    return {"$ref": f"#/components/schemas/{name}"}

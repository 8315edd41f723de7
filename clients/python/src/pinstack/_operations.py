"""What the client can do, one operation per call of the service. Both clients run these."""

from __future__ import annotations

import io
import uuid
import zipfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Union

from . import _arrays, _downloads, _events, _uploads
from ._errors import PinstackError
from ._http import Call, Clock, Operation, Request, Response, Retry, json_body, path, query, send
from ._paths import on_disk
from ._zips import PathLike, Sendable, source, with_moved

if TYPE_CHECKING:
    import pandas

JSON = Dict[str, Any]
#: A stack, calibration or scan: its JSON document, its URL or, for a stack, its id.
Reference = Union[str, Mapping[str, Any]]

#: Options of a scan that say what names mean.
RULES = frozenset({"x", "x_degrees_per_unit", "x_zero", "y", "y_degrees_per_unit", "y_zero"})
#: Columns of the table of a scan that are text, also when all their values look like numbers.
TEXTS = ("name", "label", "stack", "state", "verdict", "error", "findings", "outliers")
#: Media types by the ending of a file name.
TYPES = {".tif": "image/tiff", ".tiff": "image/tiff", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".png": "image/png"}


class Operations:
    """Builds operations; holds what all of them need."""

    def __init__(self, retry: Retry, piece_bytes: int) -> None:
        self.retry = retry
        self.piece_bytes = piece_bytes

    # -- requests ------------------------------------------------------------------------------------------------------

    def get(self, at: str, parameters: Optional[Mapping[str, str]] = None) -> Operation[Any]:
        response = yield from send(Request("GET", at, parameters or {}, repeatable=True), self.retry)
        return response.json()

    def get_bytes(self, at: str, parameters: Mapping[str, str], accept: Optional[str]) -> Operation[bytes]:
        headers = {"accept": accept} if accept else {}
        response: Response = yield from send(Request("GET", at, parameters, headers, repeatable=True), self.retry)
        return response.body

    def put(
        self, at: str, value: Any, headers: Optional[Mapping[str, str]] = None, *, repeatable: bool = True
    ) -> Operation[Any]:
        body, kind = json_body(value)
        request = Request("PUT", at, headers={**kind, **(headers or {})}, body=body, repeatable=repeatable)
        return (yield from send(request, self.retry)).json()

    def post(self, at: str, value: Any, headers: Optional[Mapping[str, str]] = None) -> Operation[Any]:
        body, kind = json_body(value)
        headers = headers or {}
        repeatable = "idempotency-key" in headers
        request = Request("POST", at, headers={**kind, **headers}, body=body, repeatable=repeatable)
        return (yield from send(request, self.retry)).json()

    def delete(self, at: str, parameters: Optional[Mapping[str, str]] = None) -> Operation[None]:
        request = Request("DELETE", at, parameters or {}, repeatable=True)
        try:
            yield from send(request, self.retry)
        except PinstackError as error:
            # deleted already: by an earlier try, or by another client
            if error.code not in ("not_found", "profile_not_found", "scan_not_found"):
                raise

    def pages(self, at: str, parameters: Mapping[str, str], most: Optional[int]) -> Operation[List[Any]]:
        """All items of a list, newest first, or the first ``most`` of them."""
        items: List[Any] = []
        cursor: Optional[str] = None
        while most is None or len(items) < most:
            page = yield from self.get(at, {**parameters, **query(cursor=cursor)})
            items.extend(page["items"])
            cursor = page["next_cursor"]
            if cursor is None:
                break
        return items[:most]

    # -- notes ---------------------------------------------------------------------------------------------------------

    def list_notes(self, at: str) -> Operation[List[Any]]:
        return (yield from self.get(at))["items"]

    def add_note(self, at: str, text: str) -> Operation[Any]:
        # a repetition after a broken connection gets the note of the first request
        return self.post(at, {"text": text}, {"idempotency-key": str(uuid.uuid4())})

    # -- profiles ------------------------------------------------------------------------------------------------------

    def put_profile(self, rig: str, lens: str, profile: Mapping[str, Any], if_match: Optional[str]) -> Operation[Any]:
        body = {**profile, "homographies": _arrays.rows(profile["homographies"])}
        headers = {"if-match": if_match} if if_match is not None else {}
        # If the response of a write is lost, a repetition makes a second revision. With If-Match it is refused as if
        # another client had written.
        return self.put(path("v1", "profiles", rig, lens), body, headers, repeatable=False)

    def calibrate(
        self, rig: str, lens: str, target: Sendable, moved: Union[PathLike, Sequence[PathLike], None],
        options: Mapping[str, Any], on_bytes: Optional[_uploads.OnBytes], on_progress: Optional[_events.OnProgress],
        timeout_s: Optional[float],
    ) -> Operation[Any]:  # fmt: skip
        values = {"rig": rig, "lens": lens, "options": dict(options), "purpose": "calibration"}
        sent: Sendable = target
        if moved is not None:
            pictures = moved
            sent = yield Call(lambda: with_moved(target, pictures))
        at = yield from self.upload(sent, values, on_bytes, None, None)
        return (yield from self.wait(at, on_progress, timeout_s, True))

    def calibrate_stored(
        self, rig: str, lens: str, stacks: Optional[Sequence[Reference]], scan: Optional[str],
        options: Mapping[str, Any], on_progress: Optional[_events.OnProgress], timeout_s: Optional[float],
    ) -> Operation[Any]:  # fmt: skip
        ids = None if stacks is None else [job_path(stack).rsplit("/", 1)[-1] for stack in stacks]
        named = {name: value for name, value in (("stacks", ids), ("scan", scan)) if value is not None}
        body, kind = json_body(named)
        at = path("v1", "profiles", rig, lens, "calibrations")
        request = Request("POST", at, query(**{"source": "stacks", **options}), kind, body)
        job = (yield from send(request, self.retry)).json()
        return (yield from self.wait(path("v1", "calibrations", job["id"]), on_progress, timeout_s, True))

    # -- stacks --------------------------------------------------------------------------------------------------------

    def upload(
        self, sendable: Sendable, values: Mapping[str, Any], on_bytes: Optional[_uploads.OnBytes],
        resume: Optional[str], on_created: Optional[Callable[[str], None]],
    ) -> Operation[str]:  # fmt: skip
        zipped = yield Call(lambda: source(sendable))
        return (yield from _uploads.upload(zipped, values, self.retry, self.piece_bytes, on_bytes, resume, on_created))

    def send_stack(
        self, sendable: Sendable, rig: str, lens: str, options: Mapping[str, Any], idempotency_key: Optional[str],
        on_bytes: Optional[_uploads.OnBytes], resume: Optional[str], on_created: Optional[Callable[[str], None]],
    ) -> Operation[Any]:  # fmt: skip
        if idempotency_key is None:
            values = {"rig": rig, "lens": lens, "options": dict(options)}
            at = yield from self.upload(sendable, values, on_bytes, resume, on_created)
            return (yield from self.get(at))
        parameters = query(rig=rig, lens=lens, **options)
        headers = {"idempotency-key": idempotency_key}
        return (yield from self.send_whole("/v1/stacks", sendable, parameters, headers, on_bytes))

    def send_whole(
        self, at: str, sendable: Sendable, parameters: Mapping[str, str], headers: Mapping[str, str],
        on_bytes: Optional[_uploads.OnBytes],
    ) -> Operation[Any]:  # fmt: skip
        """Sends a zip in one request."""
        zipped = yield Call(lambda: source(sendable))
        sent = 0

        def count(size: int) -> None:
            nonlocal sent
            sent += size
            if on_bytes is not None:
                on_bytes(sent, zipped.length)

        def begin() -> None:
            nonlocal sent
            sent = 0
            count(0)

        headers = {**headers, "content-type": "application/zip"}
        request = Request("POST", at, parameters, headers, zipped, repeatable=True, on_try=begin, on_sent=count)
        return (yield from send(request, self.retry)).json()

    def wait(
        self, job: Reference, on_progress: Optional[_events.OnProgress], timeout_s: Optional[float], check: bool
    ) -> Operation[Any]:
        at = job_path(job)
        ended = yield from _events.wait(at, self.retry, on_progress, timeout_s)
        if check and ended["state"] == "failed":
            raise PinstackError.of_problem(ended["error"])
        if check and ended["state"] == "cancelled":
            raise PinstackError("cancelled", f"{at} was cancelled")
        return ended

    def fuse(
        self, sendable: Sendable, rig: str, lens: str, options: Mapping[str, Any], on_bytes: Optional[_uploads.OnBytes],
        on_progress: Optional[_events.OnProgress], timeout_s: Optional[float],
    ) -> Operation[Any]:  # fmt: skip
        sent = yield from self.send_stack(sendable, rig, lens, options, None, on_bytes, None, None)
        return (yield from self.wait(sent, on_progress, timeout_s, True))

    def artifact(self, stack: Reference, name: str, accept: Optional[str]) -> Operation[bytes]:
        return self.get_bytes(job_path(stack) + path(*name.split("/")), {}, accept)

    def save_artifact(
        self, stack: Reference, name: str, to: PathLike, on_bytes: Optional[_uploads.OnBytes]
    ) -> Operation[Path]:
        target = Path(to)
        accept = TYPES.get(target.suffix.lower())
        headers = {"accept": accept} if accept else {}
        at = job_path(stack) + path(*name.split("/"))
        return _downloads.save(at, {}, headers, target, self.retry, on_bytes)

    def save_upload(self, stack: Reference, to: PathLike, on_bytes: Optional[_uploads.OnBytes]) -> Operation[Path]:
        return _downloads.save(f"{job_path(stack)}/upload", {}, {}, Path(to), self.retry, on_bytes)

    def array(self, stack: Reference, name: str) -> Operation[Any]:
        tiff = yield from self.artifact(stack, name, "image/tiff")
        return (yield Call(lambda: _arrays.picture(tiff)))

    def heights(self, stack: Reference, name: str) -> Operation[Any]:
        document = yield from self.get(job_path(stack))
        info = _arrays.height_info(document)
        values = yield from self.array(stack, name)
        return _arrays.heights(values, info) if name == "height" else _arrays.sigmas(values, info)

    def homographies(self, rig: str, lens: str, revision: Optional[int]) -> Operation[Any]:
        profile = yield from self.get(path("v1", "profiles", rig, lens), query(revision=revision))
        return _arrays.homographies(profile)

    # -- scans ---------------------------------------------------------------------------------------------------------

    def send_scan(
        self, scan: str, sendable: Sendable, options: Mapping[str, Any], idempotency_key: Optional[str],
        on_bytes: Optional[_uploads.OnBytes],
    ) -> Operation[Any]:  # fmt: skip
        at = path("v1", "scans", scan)
        if idempotency_key is not None:
            headers = {"idempotency-key": idempotency_key}
            yield from self.send_whole(f"{at}/archive", sendable, query(**options), headers, on_bytes)
        else:
            rules = {name: value for name, value in options.items() if name in RULES}
            of_stacks = {name: value for name, value in options.items() if name not in RULES}
            values = {"scan": scan, "options": of_stacks, "purpose": "scan", **rules}
            yield from self.upload(sendable, values, on_bytes, None, None)
        return (yield from self.get(at))

    def group(self, scan: str, sendable: Sendable, options: Mapping[str, Any]) -> Operation[Any]:
        parameters = query(**options, dry_run=True)
        return self.send_whole(path("v1", "scans", scan, "archive"), sendable, parameters, {}, None)

    def group_names(
        self, names: Sequence[str], manifest: Optional[Mapping[str, Any]], rules: Mapping[str, Any]
    ) -> Operation[Any]:
        body, kind = json_body({"names": list(names), "manifest": manifest})
        at = "/v1/groupings"
        request = Request("POST", at, query(**rules), headers=kind, body=body, repeatable=True)
        return (yield from send(request, self.retry)).json()

    def wait_scan(
        self, scan: str, on_view: Optional[Callable[[str, str], None]], timeout_s: Optional[float]
    ) -> Operation[Any]:
        """Waits for every view of a scan; one that fails does not stop the others."""
        at = path("v1", "scans", scan)
        began: float = yield Clock()
        document = yield from self.get(at)
        for view in document["views"]:
            left = None if timeout_s is None else max(began + timeout_s - (yield Clock()), 0.0)
            ended = yield from self.wait(view["stack"], None, left, False)
            if on_view is not None:
                on_view(view["name"], ended["state"])
        return (yield from self.get(at))

    def reconstruct(
        self,
        scan: str,
        options: Mapping[str, Any],
        on_progress: Optional[_events.OnProgress],
        timeout_s: Optional[float],
    ) -> Operation[Any]:
        made = yield from self.post(path("v1", "scans", scan, "reconstructions"), options)
        return (yield from self.wait(made, on_progress, timeout_s, True))

    def scan_table(self, scan: str) -> Operation[pandas.DataFrame]:
        csv = yield from self.get_bytes(path("v1", "scans", scan, "views.csv"), {}, None)
        import pandas

        return pandas.read_csv(io.BytesIO(csv), dtype=dict.fromkeys(TEXTS, str))

    def save_bundle(
        self, scan: str, layout: str, to: PathLike, partial: bool, on_bytes: Optional[_uploads.OnBytes]
    ) -> Operation[Path]:
        parameters = query(layout=layout, partial=True if partial else None)
        return _downloads.save(path("v1", "scans", scan, "bundle"), parameters, {}, Path(to), self.retry, on_bytes)

    def poses(self, file: Union[PathLike, bytes], scan: Optional[str], options: Mapping[str, Any]) -> Operation[Any]:
        body: bytes = file if isinstance(file, bytes) else (yield Call(partial(poses_of, on_disk(Path(file)))))
        at = "/v1/poses" if scan is None else path("v1", "scans", scan, "poses")
        headers = {"content-type": "application/octet-stream"}
        request = Request("POST", at, query(**options), headers, body, repeatable=True)
        return (yield from send(request, self.retry)).json()


def notes_path(stack: Optional[Reference], scan: Optional[str], profile: Optional[Tuple[str, str]]) -> str:
    """The path of the notes about a stack, a scan or a profile, of which one is given."""
    given = [job_path(stack)] if stack is not None else []
    given += [path("v1", "scans", scan)] if scan is not None else []
    given += [path("v1", "profiles", *profile)] if profile is not None else []
    if len(given) != 1:
        raise ValueError("give stack, scan or profile")
    return f"{given[0]}/notes"


def poses_of(path: Path) -> bytes:
    """The file, or a zip of the files of a COLMAP model that the report reads."""
    if not path.is_dir():
        return path.read_bytes()
    zipped = io.BytesIO()
    with zipfile.ZipFile(zipped, "w", zipfile.ZIP_DEFLATED) as model:
        for name in ("images.bin", "images.txt", "cameras.bin", "cameras.txt"):
            if (path / name).is_file():
                model.write(path / name, name)
    return zipped.getvalue()


def job_path(job: Reference) -> str:
    """The path of a stack or calibration: of its document, its path, or the id of a stack."""
    if not isinstance(job, str):
        links = job.get("links")
        return str(links["self"]) if isinstance(links, Mapping) else path("v1", "stacks", str(job["id"]))
    return job if job.startswith("/") else path("v1", "stacks", job)

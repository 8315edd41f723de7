"""The asynchronous client. Written from ``_client.py`` by ``tools/async_client.py``; do not edit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, List, Mapping, Optional, Sequence, Tuple, Union

from . import models
from ._events import OnProgress
from ._http import Request, Retry, path, query, send
from ._operations import Operations, Reference, job_path, notes_path
from ._transport import AsyncTransport
from ._uploads import OnBytes
from ._zips import PathLike, Sendable

if TYPE_CHECKING:
    import numpy
    import pandas
    from numpy.typing import NDArray

    Array = NDArray[Any]


class AsyncClient:
    """A pinstack service, for asyncio and trio.

    Every method raises :class:`PinstackError` if the service refuses the request or cannot be reached. Results are the
    JSON documents of the service, as ``dict``; their types are in :mod:`pinstack.models`.

    Args:
        url: address of the service; default: the environment variable ``PINSTACK_URL``, or ``http://127.0.0.1:8080``.
        token: access token; default: the environment variable ``PINSTACK_TOKEN``, or none.
        retry: how requests are repeated.
        piece_bytes: size of the pieces of an upload; one is in memory at a time.
        http_options: further arguments of ``httpx.AsyncClient``, such as ``verify`` or ``proxy``.

    >>> from pinstack import AsyncClient
    >>> async with AsyncClient() as client:  # doctest: +SKIP
    ...     stack = await client.fuse("view_01", "bench-1", "macro65-1x", label="beetle")
    ...     await client.save_artifact(stack, "image", "beetle.png")
    """

    def __init__(
        self,
        url: Optional[str] = None,
        token: Optional[str] = None,
        *,
        retry: Optional[Retry] = None,
        piece_bytes: int = 8 << 20,
        **http_options: Any,
    ) -> None:
        self._transport = AsyncTransport(url, token, **http_options)
        self._do = Operations(retry if retry is not None else Retry(), piece_bytes)

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Closes the connections."""
        await self._transport.close()

    @property
    def url(self) -> str:
        """Address of the service."""
        return self._transport.url

    # -- the service ---------------------------------------------------------------------------------------------------

    async def info(self) -> models.Info:
        """Version, limits, formats and default options of the service."""
        return await self._transport.run(self._do.get("/v1/info"))

    # -- profiles ------------------------------------------------------------------------------------------------------

    async def list_profiles(
        self, rig: Optional[str] = None, lens: Optional[str] = None, *, most: Optional[int] = None
    ) -> List[models.ProfileSummary]:
        """The current profiles, newest first."""
        return await self._transport.run(self._do.pages("/v1/profiles", query(rig=rig, lens=lens), most))

    async def list_revisions(self, rig: str, lens: str) -> List[models.ProfileSummary]:
        """All revisions of a profile, newest first."""
        return await self._transport.run(self._do.pages(path("v1", "profiles", rig, lens, "revisions"), {}, None))

    async def get_profile(self, rig: str, lens: str, revision: Optional[int] = None) -> models.Profile:
        """A profile; its current revision by default."""
        return await self._transport.run(self._do.get(path("v1", "profiles", rig, lens), query(revision=revision)))

    async def put_profile(
        self, rig: str, lens: str, profile: Mapping[str, Any], *, if_match: Optional[str] = None
    ) -> models.Profile:
        """Stores homographies that were measured elsewhere as the next revision.

        It is not repeated after a broken connection, because each write makes a revision.

        Args:
            profile: a ``models.ProfileInput``. Its ``homographies`` may be a numpy array, ``N x 3 x 3``; each maps a
                slice pixel (x, y) to a reference-slice pixel.
            if_match: the ``ETag`` of the revision that is to be replaced; refused if it is not the current one.
        """
        return await self._transport.run(self._do.put_profile(rig, lens, profile, if_match))

    async def delete_profile(self, rig: str, lens: str) -> None:
        """Deletes a profile with all its revisions; stacks keep what they used. Nothing if there is none."""
        return await self._transport.run(self._do.delete(path("v1", "profiles", rig, lens)))

    async def export_profile(self, rig: str, lens: str, *, format: str = "json", revision: Optional[int] = None) -> bytes:
        """A profile as a file for another server (``json``) or for numpy (``npz``)."""
        parameters = query(format=format, revision=revision)
        return await self._transport.run(self._do.get_bytes(path("v1", "profiles", rig, lens, "export"), parameters, None))

    async def homographies(self, rig: str, lens: str, revision: Optional[int] = None) -> NDArray[numpy.float64]:
        """The homographies of a profile, ``N x 3 x 3``, from slice pixels (x, y) to reference-slice pixels."""
        return await self._transport.run(self._do.homographies(rig, lens, revision))

    # -- calibrations --------------------------------------------------------------------------------------------------

    async def calibrate(
        self,
        rig: str,
        lens: str,
        target: Optional[Sendable] = None,
        *,
        moved: Union[PathLike, Sequence[PathLike], None] = None,
        stacks: Optional[Sequence[Reference]] = None,
        scan: Optional[str] = None,
        from_revision: Optional[int] = None,
        on_bytes: Optional[OnBytes] = None,
        on_progress: Optional[OnProgress] = None,
        timeout_s: Optional[float] = None,
        **options: Any,
    ) -> models.Calibration:
        """Calibrates a rig and lens from photographs of a dot target, and waits for the result.

        Without a target, with ``source="stacks"``, ``target`` is a stack or the folders of several views, or ``stacks``
        or ``scan`` name pictures that the service has already.

        Args:
            target: a zip, a folder or a list of the slices.
            moved: the same target nearer to the lens by ``target_advance_mm``, which measures the camera: one picture
                with the rail where it was for the reference slice, or a folder or list with one for each slice. In a
                zip or folder ``target`` it may be the folder ``moved`` instead.
            stacks: stored stacks of this rig, instead of ``target``: their pictures are not sent again.
            scan: a stored scan, instead of ``target``.
            from_revision: the revision of the profile that stacks refine: its homographies follow the pictures, and
                the rest of it is kept.
            on_bytes: called with bytes sent and their total.
            on_progress: called with the progress of the job.
            timeout_s: longest time to wait for the job after the upload, seconds; default: no limit.
            options: ``focal_mm``, ``pixel_pitch_mm``, ``target_pitch_mm``, ... of ``models.CalibrationOptions``.
        """
        if from_revision is not None:
            options = {"source": "stacks", **options, "from": from_revision}
        if target is not None and stacks is None and scan is None:
            operation = self._do.calibrate(rig, lens, target, moved, options, on_bytes, on_progress, timeout_s)
        elif target is None and moved is None:
            operation = self._do.calibrate_stored(rig, lens, stacks, scan, options, on_progress, timeout_s)
        else:
            raise ValueError("give target, stacks or scan")
        return await self._transport.run(operation)

    async def list_calibrations(
        self,
        *,
        rig: Optional[str] = None,
        lens: Optional[str] = None,
        state: Optional[models.JobState] = None,
        most: Optional[int] = None,
    ) -> List[models.Calibration]:
        """Calibrations, newest first."""
        return await self._transport.run(self._do.pages("/v1/calibrations", query(rig=rig, lens=lens, state=state), most))

    async def get_calibration(self, id: str) -> models.Calibration:
        """A calibration."""
        return await self._transport.run(self._do.get(path("v1", "calibrations", id)))

    async def calibration_report(self, id: str) -> bytes:
        """The report of a calibration as an HTML page."""
        return await self._transport.run(self._do.get_bytes(path("v1", "calibrations", id, "report"), {}, "text/html"))

    # -- stacks --------------------------------------------------------------------------------------------------------

    async def send_stack(
        self,
        slices: Sendable,
        rig: str,
        lens: str,
        *,
        idempotency_key: Optional[str] = None,
        on_bytes: Optional[OnBytes] = None,
        resume: Optional[str] = None,
        on_created: Optional[Callable[[str], None]] = None,
        **options: Any,
    ) -> models.Stack:
        """Sends a stack and returns as soon as the service has stored it.

        Args:
            slices: a zip, a folder with ``front`` and ``back`` or with slices, a list of front-light slices, or
                ``{"front": [...], "back": [...]}``. Folders and lists are zipped while they are sent.
            idempotency_key: send it in one request with this key: a repetition with the same key and zip gets the
                first stack, also from another process. Without it the upload is resumable.
            on_bytes: called with bytes sent and their total.
            resume: path of an upload that ``on_created`` told earlier; it continues where it was cut off. A new upload
                begins if the service has it no longer, or has refused it.
            on_created: called with the path of the upload as soon as it exists.
            options: ``label``, ``scan``, ``pan_deg``, ``method``, ... of ``models.StackOptionsInput``.
        """
        operation = self._do.send_stack(slices, rig, lens, options, idempotency_key, on_bytes, resume, on_created)
        return await self._transport.run(operation)

    async def fuse(
        self,
        slices: Sendable,
        rig: str,
        lens: str,
        *,
        on_bytes: Optional[OnBytes] = None,
        on_progress: Optional[OnProgress] = None,
        timeout_s: Optional[float] = None,
        **options: Any,
    ) -> models.Stack:
        """Sends a stack and waits until it is fused. Arguments as for ``send_stack`` and ``wait``."""
        operation = self._do.fuse(slices, rig, lens, options, on_bytes, on_progress, timeout_s)
        return await self._transport.run(operation)

    async def wait(
        self,
        job: Reference,
        *,
        on_progress: Optional[OnProgress] = None,
        timeout_s: Optional[float] = None,
        check: bool = True,
    ) -> Any:
        """Waits until a stack or calibration has ended, and returns it.

        Args:
            job: its document or path, or the id of a stack.
            on_progress: called with its progress.
            timeout_s: longest time to wait, seconds; then ``PinstackError`` with the code ``timeout``.
            check: raise the error of a job that failed or was cancelled; otherwise return it.
        """
        return await self._transport.run(self._do.wait(job, on_progress, timeout_s, check))

    async def list_stacks(
        self,
        *,
        rig: Optional[str] = None,
        lens: Optional[str] = None,
        scan: Optional[str] = None,
        state: Optional[models.JobState] = None,
        verdict: Optional[models.Verdict] = None,
        q: Optional[str] = None,
        since: Optional[str] = None,
        until: Optional[str] = None,
        most: Optional[int] = None,
    ) -> List[models.Stack]:
        """Stacks, newest first.

        Args:
            q: words of label, scan, rig, lens and file name; the beginning of a word is enough.
            since: the first day (``"2026-11-27"``, UTC) or time of acceptance.
            until: the last day or time.
            most: at most this many.
        """
        parameters = query(rig=rig, lens=lens, scan=scan, state=state, verdict=verdict, q=q, since=since, until=until)
        return await self._transport.run(self._do.pages("/v1/stacks", parameters, most))

    async def count_stacks(
        self,
        *,
        rig: Optional[str] = None,
        lens: Optional[str] = None,
        scan: Optional[str] = None,
        q: Optional[str] = None,
        since: Optional[str] = None,
        until: Optional[str] = None,
    ) -> models.StackTotals:
        """Numbers of stacks by verdict, each counted up to 10,000. The arguments are those of ``list_stacks``."""
        parameters = query(rig=rig, lens=lens, scan=scan, q=q, since=since, until=until)
        return await self._transport.run(self._do.get("/v1/stack-totals", parameters))

    async def get_stack(self, stack: Reference) -> models.Stack:
        """A stack as it is now."""
        return await self._transport.run(self._do.get(job_path(stack)))

    async def metrics(self, stack: Reference) -> models.Metrics:
        """The quality metrics of a stack."""
        return await self._transport.run(self._do.get(f"{job_path(stack)}/metrics"))

    async def rerun_stack(self, stack: Reference, **options: Any) -> models.Stack:
        """Fuses the stored zip of a stack again with other options; None resets an option to its default."""
        return await self._transport.run(self._do.post(f"{job_path(stack)}/rerun", options))

    async def cancel(self, job: Reference) -> Any:
        """Cancels a stack or calibration, and returns it."""
        return await self._transport.run(self._do.post(f"{job_path(job)}/cancel", {}))

    async def delete(self, job: Reference) -> None:
        """Deletes a stack or calibration with its files. Nothing if there is none."""
        return await self._transport.run(self._do.delete(job_path(job)))

    # -- results -------------------------------------------------------------------------------------------------------

    async def artifact(self, stack: Reference, name: str, *, accept: Optional[str] = None) -> bytes:
        """A result file as bytes.

        Args:
            name: a name in ``stack["artifacts"]``, such as ``image``, ``mask`` or ``lights/uv``.
            accept: media type, such as ``image/tiff``; default: the type that the stack was fused with.
        """
        return await self._transport.run(self._do.artifact(stack, name, accept))

    async def save_artifact(self, stack: Reference, name: str, to: PathLike, *, on_bytes: Optional[OnBytes] = None) -> Path:
        """Saves a result file. A broken download is resumed.

        The ending of ``to`` chooses the type if the artifact has it; otherwise the stored type is saved under that
        name.
        """
        return await self._transport.run(self._do.save_artifact(stack, name, to, on_bytes))

    async def save_upload(self, stack: Reference, to: PathLike, *, on_bytes: Optional[OnBytes] = None) -> Path:
        """Saves the zip as it was sent."""
        return await self._transport.run(self._do.save_upload(stack, to, on_bytes))

    async def image(self, stack: Reference) -> Array:
        """The fused image, ``H x W x 4`` (RGBA), 8 or 16 bits; without a mask, alpha is full. With ``format="jpeg"``,
        ``H x W x 3``."""
        return await self._transport.run(self._do.array(stack, "image"))

    async def mask(self, stack: Reference) -> Array:
        """The mask, ``H x W``, 8 bits: 255 where the object is."""
        return await self._transport.run(self._do.array(stack, "mask"))

    async def depth(self, stack: Reference) -> Array:
        """The index of the sharpest slice, ``H x W``, 16 bits."""
        return await self._transport.run(self._do.array(stack, "depth"))

    async def light(self, stack: Reference, name: str) -> Array:
        """A further light, fused by the decision map of the front light; shape and alpha are those of the image.

        Args:
            name: the name of its folder, a key of ``stack["links"]["lights"]``.
        """
        return await self._transport.run(self._do.array(stack, f"lights/{name}"))

    async def height(self, stack: Reference) -> NDArray[numpy.float64]:
        """The height map, ``H x W``, in the unit ``stack["height"]["unit"]``; NaN where the height is unknown."""
        return await self._transport.run(self._do.heights(stack, "height"))

    async def height_sigma(self, stack: Reference) -> NDArray[numpy.float64]:
        """The standard deviations of the heights in the same unit; NaN where the height is unknown."""
        return await self._transport.run(self._do.heights(stack, "height-sigma"))

    # -- scans ---------------------------------------------------------------------------------------------------------

    async def list_scans(
        self, *, rig: Optional[str] = None, lens: Optional[str] = None, most: Optional[int] = None
    ) -> List[models.Scan]:
        """Scans, newest first."""
        return await self._transport.run(self._do.pages("/v1/scans", query(rig=rig, lens=lens), most))

    async def put_scan(self, scan: str, rig: str, lens: str, **members: Any) -> models.Scan:
        """Creates or replaces what is said of a scan: ``specimen``, ``radius_mm``, ... of ``models.ScanInput``."""
        return await self._transport.run(self._do.put(path("v1", "scans", scan), {"rig": rig, "lens": lens, **members}))

    async def get_scan(self, scan: str) -> models.ScanWithViews:
        """A scan with its views, outliers and missing angles."""
        return await self._transport.run(self._do.get(path("v1", "scans", scan)))

    async def delete_scan(self, scan: str, *, with_stacks: bool = False) -> None:
        """Deletes a scan; one with stacks only with ``with_stacks``. Nothing if there is none."""
        parameters = query(stacks="delete" if with_stacks else None)
        return await self._transport.run(self._do.delete(path("v1", "scans", scan), parameters))

    async def group(self, scan: str, views: Sendable, **options: Any) -> models.ScanArchiveView:
        """How the service groups the slices of a zip or folder into views. It makes nothing."""
        return await self._transport.run(self._do.group(scan, views, options))

    async def group_names(
        self, names: Sequence[str], manifest: Optional[Mapping[str, Any]] = None, **rules: Any
    ) -> models.NameGrouping:
        """How the service groups file names into views, before anything is sent. It makes nothing.

        Args:
            names: of all files below a folder, relative to it, with ``/`` between folders.
            manifest: the content of the ``manifest.json`` among them.
            rules: what numbers in names mean: ``x_degrees_per_unit``, ``x_zero``, ``x="pan"``, and the same for ``y``.
        """
        return await self._transport.run(self._do.group_names(names, manifest, rules))

    async def send_scan(
        self,
        scan: str,
        views: Sendable,
        *,
        idempotency_key: Optional[str] = None,
        on_bytes: Optional[OnBytes] = None,
        **options: Any,
    ) -> models.ScanWithViews:
        """Sends all views of a scan: a zip, or a folder with a folder per view. Returns the scan.

        Args:
            idempotency_key: as for ``send_stack``.
            options: options of stacks, for every view; and what names mean: ``x_degrees_per_unit``, ``x_zero``,
                ``x="pan"``, and the same for ``y``.
        """
        return await self._transport.run(self._do.send_scan(scan, views, options, idempotency_key, on_bytes))

    async def wait_scan(
        self,
        scan: str,
        *,
        on_view: Optional[Callable[[str, str], None]] = None,
        timeout_s: Optional[float] = None,
    ) -> models.ScanWithViews:
        """Waits until every view has ended, and returns the scan; ``on_view`` gets name and state of each."""
        return await self._transport.run(self._do.wait_scan(scan, on_view, timeout_s))

    async def rerun_scan(self, scan: str, **options: Any) -> models.ScanRerun:
        """Fuses every view again with other options."""
        return await self._transport.run(self._do.post(path("v1", "scans", scan, "rerun"), options))

    async def scan_table(self, scan: str) -> pandas.DataFrame:
        """The views with their metrics as a table of pandas."""
        return await self._transport.run(self._do.scan_table(scan))

    async def save_bundle(
        self, scan: str, layout: str, to: PathLike, *, partial: bool = False, on_bytes: Optional[OnBytes] = None
    ) -> Path:
        """Saves the zip for a reconstruction program: ``colmap``, ``meshroom``, ``metashape``, ...

        A broken download is resumed. ``partial`` leaves out views without a result.
        """
        return await self._transport.run(self._do.save_bundle(scan, layout, to, partial, on_bytes))

    async def poses(self, file: Union[PathLike, bytes], *, scan: Optional[str] = None, **options: Any) -> models.PoseReport:
        """How exactly a reconstruction program placed the cameras of a turntable scan. Stores nothing.

        Args:
            file: path or bytes of the poses, as COLMAP, AliceVision, Meshroom, Metashape or OpenMVG write them, or CSV.
                The folder of a COLMAP model has the focal length, too, which is compared with that of the calibration.
            scan: the scan that was reconstructed: gives commanded angles, expected views and radius. Without it the
                angles are those of the names of the views.
            options: ``file_format``, ``expected``, ``radius_mm``, or ``pair_from``, ``pair_to`` and ``pair_mm``; as a
                known length of the object ``length_from``, ``length_to`` (x, y, z in the file) and ``length_mm``.

        >>> client.poses("model/0", scan="beetle")["pan_steps"]  # doctest: +SKIP
        """
        return await self._transport.run(self._do.poses(file, scan, options))

    # -- reconstructions -----------------------------------------------------------------------------------------------

    async def start_reconstruction(self, scan: str, **options: Any) -> models.Reconstruction:
        """Has COLMAP reconstruct the views of a scan, and returns at once; ``wait`` waits for it.

        Args:
            scan: the scan; all its views must have a result.
            options: ``partial=True`` leaves out views without a result; ``max_error_px`` is the largest error of
                reprojection.
        """
        return await self._transport.run(self._do.post(path("v1", "scans", scan, "reconstructions"), options))

    async def reconstruct(
        self,
        scan: str,
        *,
        on_progress: Optional[OnProgress] = None,
        timeout_s: Optional[float] = None,
        **options: Any,
    ) -> models.Reconstruction:
        """The same, and waits until it has ended. Its files: ``artifact(reconstruction, "points")``, ``"cameras"``, ...

        >>> [finding["detail"] for finding in client.reconstruct("beetle")["result"]["findings"]]  # doctest: +SKIP
        """
        return await self._transport.run(self._do.reconstruct(scan, options, on_progress, timeout_s))

    async def list_reconstructions(self, scan: str, *, most: Optional[int] = None) -> List[models.Reconstruction]:
        """The reconstructions of a scan, newest first."""
        return await self._transport.run(self._do.pages(path("v1", "scans", scan, "reconstructions"), query(), most))

    async def get_reconstruction(self, id: str) -> models.Reconstruction:
        """A reconstruction."""
        return await self._transport.run(self._do.get(path("v1", "reconstructions", id)))

    # -- notes ---------------------------------------------------------------------------------------------------------

    async def list_notes(
        self,
        stack: Optional[Reference] = None,
        *,
        scan: Optional[str] = None,
        profile: Optional[Tuple[str, str]] = None,
    ) -> List[models.Note]:
        """What people wrote about a stack, a scan, or the profile of a rig and lens, the oldest first."""
        return await self._transport.run(self._do.list_notes(notes_path(stack, scan, profile)))

    async def add_note(
        self,
        text: str,
        stack: Optional[Reference] = None,
        *,
        scan: Optional[str] = None,
        profile: Optional[Tuple[str, str]] = None,
    ) -> models.Note:
        """Writes a note of 1 to 2,000 characters about a stack, a scan, or the profile of a rig and lens.

        >>> client.add_note("left antenna broken", scan="beetle")  # doctest: +SKIP
        """
        return await self._transport.run(self._do.add_note(notes_path(stack, scan, profile), text))

    async def delete_note(
        self,
        id: str,
        stack: Optional[Reference] = None,
        *,
        scan: Optional[str] = None,
        profile: Optional[Tuple[str, str]] = None,
    ) -> None:
        """Deletes a note; only its author and an admin may. Nothing if there is none."""
        return await self._transport.run(self._do.delete(f"{notes_path(stack, scan, profile)}{path(id)}"))

    # -- anything else -------------------------------------------------------------------------------------------------

    async def request(
        self, method: str, path: str, *, query: Optional[Mapping[str, str]] = None, body: Optional[bytes] = None
    ) -> bytes:
        """Sends a request that no method is for, with a JSON body if there is one. Returns the body of the response."""
        headers = {"content-type": "application/json"} if body is not None else {}
        request = Request(method, path, query or {}, headers, body, repeatable=method == "GET")
        return (await self._transport.run(send(request, self._do.retry))).body

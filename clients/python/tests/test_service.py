"""The client with a running service: the binary in ``PINSTACK_TEST_BINARY``."""

from __future__ import annotations

import asyncio
import json
import math
import subprocess
import zipfile
from pathlib import Path
from typing import List, Tuple

import pytest
from conftest import Service, binary

from pinstack import AsyncClient, Client, PinstackError, Retry, StoredZip

numpy = pytest.importorskip("numpy")
tifffile = pytest.importorskip("tifffile")

OPTICS = {"focal_mm": 65.0, "pixel_pitch_mm": 0.02}


@pytest.fixture(scope="module")
def calibrated(service: Service, zips: Path) -> Tuple[str, str]:
    """Rig and lens of a profile that fits the stack."""
    fractions: List[float] = []
    with Client(service.url) as client:
        calibration = client.calibrate(
            "bench-1", "macro65", zips / "target.zip", on_progress=lambda p: fractions.append(p["fraction"]), **OPTICS
        )
        assert calibration["state"] == "succeeded" and fractions == sorted(fractions) and fractions[-1] == 1.0
        report = client.calibration_report(calibration["id"])
        assert b"<html" in report.lower()
        assert client.get_calibration(calibration["id"])["options"]["focal_mm"] == 65.0
        assert [one["id"] for one in client.list_calibrations(rig="bench-1")] == [calibration["id"]]
    return "bench-1", "macro65"


def test_a_moved_target_is_sent_with_the_slices(client: Client, zips: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(zips / "target.zip") as target:
        target.extractall(tmp_path / "target")
    # the sensor is farther away in the first slice, so its dots are larger, as those of a target that is nearer
    larger = min((tmp_path / "target").iterdir())
    numbers = {"pixel_pitch_mm": 24 / 420, "target_pitch_mm": 1.19, "target_advance_mm": 4}
    calibration = client.calibrate("bench-3", "macro65", tmp_path / "target", moved=larger, **numbers)
    assert calibration["state"] == "succeeded"
    assert client.get_profile("bench-3", "macro65")["principal_distance_source"] == "moved_target"


def test_a_folder_is_fused_and_the_results_are_arrays(
    client: Client, calibrated: Tuple[str, str], zips: Path, tmp_path: Path
) -> None:
    told: List[Tuple[int, int]] = []
    stages: List[str] = []
    stack = client.fuse(
        zips / "stack", *calibrated, label="beetle", height="auto", bit_depth="16",
        on_bytes=lambda *bytes: told.append(bytes), on_progress=lambda progress: stages.append(progress["stage"]),
    )  # fmt: skip
    length = StoredZip.of_folder(zips / "stack").length
    assert told[-1] == (length, length) == (stack["upload"]["bytes"], length) and stages[-1] == "done"
    assert len(stack["slices"]["front"]) == len(stack["slices"]["back"]) == 5
    image, mask, depth = client.image(stack), client.mask(stack), client.depth(stack)
    assert (image.dtype, image.shape) == (numpy.uint16, (*mask.shape, 4)) and mask.dtype == numpy.uint8
    assert set(numpy.unique(mask)) == {0, 255} and (image[..., 3] > 0).tolist() == (mask > 0).tolist()
    assert depth.dtype == numpy.uint16 and 0 < depth.max() < 5
    height, sigma = client.height(stack), client.height_sigma(stack)
    known = ~numpy.isnan(height)
    assert known.sum() > 1000 and not known[mask == 0].any() and (~numpy.isnan(sigma)).tolist() == known.tolist()
    info = client.get_stack(stack)["height"]
    assert info is not None and numpy.nanmedian(sigma) == pytest.approx(info["median_sigma"], rel=0.05)
    assert client.metrics(stack)["alignment"]["residual_p95_px"] is not None
    saved = client.save_artifact(stack, "mask", tmp_path / "mask.tif")
    assert (tifffile.imread(saved) == mask).all()
    sent = client.save_upload(stack, tmp_path / "sent.zip")
    assert sent.read_bytes() == b"".join(StoredZip.of_folder(zips / "stack").blocks())
    again = client.wait(client.rerun_stack(stack, method="pyramid", mask="none", bit_depth=None, height=None))
    opaque = client.image(again)
    assert again["options"]["method"] == "pyramid" and opaque.dtype == numpy.uint8
    assert opaque.shape[2] == 4 and (opaque[..., 3] == 255).all()
    with pytest.raises(PinstackError) as caught:
        client.height(again)
    assert caught.value.code == "no_result"
    client.delete(again)
    client.delete(again)


def test_further_lights_are_sent_by_name_and_lie_on_the_image(
    client: Client, calibrated: Tuple[str, str], zips: Path, tmp_path: Path
) -> None:
    front = sorted((zips / "stack" / "front").iterdir())
    stack = client.fuse({"front": front, "uv": front, "left_45": front}, *calibrated)
    assert [light["name"] for light in stack["slices"].get("lights", [])] == ["left_45", "uv"]
    assert sorted(stack["links"].get("lights", {})) == ["left_45", "uv"]
    image, light = client.image(stack), client.light(stack, "uv")
    assert light.shape == image.shape and (light[..., 3] == image[..., 3]).all()
    assert abs(light.astype(int) - image).mean() < 3
    saved = client.save_artifact(stack, "lights/uv", tmp_path / "uv.tif")
    assert (tifffile.imread(saved) == light).all()
    with pytest.raises(PinstackError) as caught:
        client.light(stack, "ir")
    assert caught.value.code == "no_result" and "left_45, uv" in caught.value.detail
    with pytest.raises(PinstackError, match="has 1 slice and the front light 5"):
        client.fuse({"front": front, "uv": front[:1]}, *calibrated)


def test_a_list_of_slices_and_an_idempotency_key(client: Client, calibrated: Tuple[str, str], zips: Path) -> None:
    lights = {light: sorted((zips / "stack" / light).iterdir()) for light in ("front", "back")}
    first = client.send_stack(lights, *calibrated, idempotency_key="view-1", label="by list", tilt_deg=-2.5)
    again = client.send_stack(lights, *calibrated, idempotency_key="view-1", label="by list", tilt_deg=-2.5)
    assert first["id"] == again["id"] and first["options"]["tilt_deg"] == -2.5
    ended = client.wait(first)
    front_only = client.fuse(lights["front"], *calibrated, label="front only")
    assert "mask" in ended["links"] and "mask" not in front_only["links"]


def test_profiles_go_in_and_out_as_arrays(client: Client, calibrated: Tuple[str, str]) -> None:
    profile = client.get_profile(*calibrated)
    matrices = client.homographies(*calibrated)
    assert matrices.shape == (5, 3, 3) and (matrices[:, 2, 2] == 1).all()
    given = {key: profile[key] for key in ("image_width", "image_height", "reference_index")}
    stored = client.put_profile("bench-2", "macro65", {**given, "homographies": matrices, "note": "from numpy"})
    assert (client.homographies("bench-2", "macro65") == matrices).all()
    client.put_profile("bench-2", "macro65", {**given, "homographies": matrices.reshape(-1, 9).tolist()})
    assert [one["revision"] for one in client.list_revisions("bench-2", "macro65")] == [2, stored["revision"]]
    assert client.get_profile("bench-2", "macro65", 1)["note"] == "from numpy"
    assert json.loads(client.export_profile("bench-2", "macro65"))
    assert client.export_profile("bench-2", "macro65", format="npz").startswith(b"PK")
    assert {one["rig"] for one in client.list_profiles()} >= {"bench-1", "bench-2"}
    client.delete_profile("bench-2", "macro65")
    with pytest.raises(PinstackError) as caught:
        client.get_profile("bench-2", "macro65")
    assert (caught.value.code, caught.value.status) == ("profile_not_found", 404) and caught.value.request_id


@pytest.fixture
def views(zips: Path, tmp_path: Path) -> Path:
    """A folder with two views."""
    folder = tmp_path / "beetle"
    for name in ("pan000_tilt15", "pan020_tilt15"):
        with zipfile.ZipFile(zips / "stack.zip") as stack:
            stack.extractall(folder / name)
    return folder


def test_notes_are_written_listed_and_deleted(client: Client, calibrated: Tuple[str, str]) -> None:
    note = client.add_note("the rail was cleaned\nand oiled", profile=calibrated)
    assert client.list_notes(profile=calibrated) == [note]
    assert (note["text"], note["author"]) == ("the rail was cleaned\nand oiled", None)
    client.delete_note(note["id"], profile=calibrated)
    client.delete_note(note["id"], profile=calibrated)
    assert client.list_notes(profile=calibrated) == []
    with pytest.raises(ValueError, match="stack, scan or profile"):
        client.add_note("about what?")


def test_a_folder_of_views_becomes_a_scan_with_a_table_and_a_bundle(
    client: Client, calibrated: Tuple[str, str], views: Path, tmp_path: Path
) -> None:
    pytest.importorskip("pandas")
    client.put_scan("beetle", *calibrated, specimen="C-17", expected_views=2, radius_mm=140.0)
    grouping = client.group("beetle", views)
    assert [(view["pan_deg"], view["front"], view["back"]) for view in grouping["views"]] == [(0, 5, 5), (20, 5, 5)]
    assert client.list_stacks(scan="beetle") == []
    client.send_scan("beetle", views, method="pyramid")
    ended: List[str] = []
    scan = client.wait_scan("beetle", on_view=lambda name, state: ended.append(state))
    assert ended == ["succeeded"] * 2 and scan["specimen"] == "C-17"
    table = client.scan_table("beetle")
    assert list(table["pan_deg"]) == [0, 20] and set(table["state"]) == {"succeeded"}
    poses = write_poses(tmp_path / "poses.csv", (0, 15))
    for given in (poses, poses.read_bytes()):
        report = client.poses(given, scan="beetle")
        assert (report["expected"], report["registered"]) == (2, 2)
    bundle = client.save_bundle("beetle", "colmap", tmp_path / "bundle.zip")
    with zipfile.ZipFile(bundle) as read:
        assert read.testzip() is None and any(name.startswith("masks/") for name in read.namelist())
    again = client.rerun_scan("beetle", method="guided")
    assert len(again["views"]) == 2
    assert [one["name"] for one in client.list_scans()] == ["beetle"]
    client.wait_scan("beetle")
    client.delete_scan("beetle", with_stacks=True)
    assert client.list_scans() == []


def write_poses(path: Path, tilts: Tuple[int, int]) -> Path:
    """A CSV file with 36 camera centres on a sphere with the radius 2."""
    rows = ["name,x,y,z"]
    for tilt in tilts:
        for pan in range(0, 360, 20):
            ring, height = 2.0 * math.cos(math.radians(tilt)), 2.0 * math.sin(math.radians(tilt))
            x, y = ring * math.cos(math.radians(pan)), ring * math.sin(math.radians(pan))
            rows.append(f"pan{pan:03}_tilt{tilt:02}.png,{x},{y},{height}")
    path.write_text("\n".join(rows), encoding="utf-8")
    return path


def test_poses_of_a_turntable_are_reported(client: Client, calibrated: Tuple[str, str], tmp_path: Path) -> None:
    table = write_poses(tmp_path / "poses.csv", (0, 10))
    report = client.poses(table, expected=40, radius_mm=141.0)
    assert (report["registered"], report["expected"]) == (36, 40)
    assert report["surface"] is not None and report["surface"]["radius"] == pytest.approx(141.0)
    assert report["pan_steps"] is not None and report["pan_steps"]["mean_deg"] == pytest.approx(20.0, abs=1e-3)
    client.put_scan("posed", *calibrated, expected_views=38)
    with pytest.raises(PinstackError, match="no views yet"):
        client.poses(table, scan="posed")
    client.delete_scan("posed")
    model = tmp_path / "model"
    model.mkdir()
    (model / "points3D.txt").write_text("not sent")
    (model / "cameras.txt").write_text("1 SIMPLE_PINHOLE 810 540 2712.5 405 270\n")
    (model / "images.txt").write_text("1 0.5 -0.5 0.5 0.5 0 0 141 1 pan000_tilt00.png\n\n")
    report = client.poses(model)
    assert (report["format"], report["registered"]) == ("colmap_text", 1)
    with pytest.raises(PinstackError) as caught:
        client.poses(b"not a file of poses")
    assert caught.value.status == 422


def test_motor_steps_become_angles(client: Client, calibrated: Tuple[str, str], views: Path, tmp_path: Path) -> None:
    client.put_scan("steps", *calibrated)
    folder = tmp_path / "steps"
    for view, name in ((views / "pan000_tilt15", "_x_00000_y_00400"), (views / "pan020_tilt15", "_x_00100_y_00400")):
        (folder / name).parent.mkdir(exist_ok=True)
        view.rename(folder / name)
    scan = client.send_scan("steps", folder, x_degrees_per_unit=0.1, y_degrees_per_unit=-0.225)
    assert [(view["tilt_deg"], view["pan_deg"]) for view in scan["views"]] == [(0, -90), (10, -90)]
    for stack in client.list_stacks(scan="steps"):
        client.cancel(stack) if stack["state"] in ("queued", "running") else None
        assert client.wait(stack, check=False)["state"] in ("cancelled", "succeeded")
    client.delete_scan("steps", with_stacks=True)


def test_refusals_name_the_file(client: Client, calibrated: Tuple[str, str], zips: Path, tmp_path: Path) -> None:
    (tmp_path / "front").mkdir()
    for number, slice in enumerate(sorted((zips / "stack/front").iterdir())):
        data = slice.read_bytes()
        (tmp_path / "front" / f"{number}.jpg").write_bytes(data if number != 3 else b"no picture at all")
    with pytest.raises(PinstackError, match=r"front/3\.jpg") as caught:
        client.fuse(tmp_path, *calibrated)
    assert caught.value.code == "invalid_image"
    assert any(location.get("file") == "front/3.jpg" for location in caught.value.errors)
    with pytest.raises(PinstackError, match="macro66"):
        client.fuse(zips / "stack", "bench-1", "macro66")


def test_an_upload_survives_kill_9_of_the_service(zips: Path, tmp_path: Path) -> None:
    service = Service(tmp_path)
    try:
        with Client(service.url, retry=Retry(attempts=40, first_s=0.05, longest_s=0.2), piece_bytes=20_000) as client:
            client.calibrate("rig", "lens", zips / "target.zip")
            kills = 0

            def kill(done: int, total: int) -> None:
                nonlocal kills
                if kills < 2 and done >= (kills + 1) * total // 3:
                    kills += 1
                    service.kill()
                    service.start()

            stack = client.fuse(zips / "stack", "rig", "lens", on_bytes=kill)
            assert kills == 2 and stack["state"] == "succeeded"
            assert [one["id"] for one in client.list_stacks()] == [stack["id"]]
            sent = client.save_upload(stack, tmp_path / "sent.zip").read_bytes()
            assert sent == b"".join(StoredZip.of_folder(zips / "stack").blocks())
    finally:
        service.kill()


def test_a_token_is_needed_and_sent(tmp_path: Path) -> None:
    data = str(tmp_path / "data")
    command = [binary(), "token", "add", "reader", "--scope", "read", "--data-dir", data]
    token = subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    service = Service(tmp_path)
    try:
        with Client(service.url, token) as reader, Client(service.url) as stranger:
            assert reader.info()["name"] == "pinstack"
            with pytest.raises(PinstackError) as caught:
                stranger.info()
            assert caught.value.code == "unauthorized"
            with pytest.raises(PinstackError) as caught:
                reader.put_scan("s", "rig", "lens")
            assert caught.value.code == "forbidden"
    finally:
        service.kill()


def test_a_session_of_the_asynchronous_client(
    service: Service, calibrated: Tuple[str, str], zips: Path, tmp_path: Path
) -> None:
    async def session() -> None:
        async with AsyncClient(service.url) as client:
            names = ["a", "b", "c"]
            stacks = await asyncio.gather(
                *(client.fuse(zips / "stack", *calibrated, label=name, method="pyramid") for name in names)
            )
            assert [stack["options"]["label"] for stack in stacks] == names
            mask = await client.mask(stacks[0])
            saved = await client.save_artifact(stacks[0], "mask", tmp_path / "mask.tif")
            assert (tifffile.imread(saved) == mask).all()

    asyncio.run(session())

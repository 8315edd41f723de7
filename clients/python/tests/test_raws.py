"""Camera raw files become pictures: values, size, tags, what is refused. The files are DNG files of :mod:`dng`."""

from __future__ import annotations

import io
import json
import re
import threading
from pathlib import Path
from typing import Any, Dict, List, Optional

import pytest
from conftest import PROJECT
from dng import ASCII, Dng

from pinstack import Member, PinstackError, StoredZip
from pinstack.push import lights, raws
from pinstack.push.bursts import time_taken
from pinstack.push.cli import main
from pinstack.push.converter import Converter, Memory
from pinstack.push.exif import Exif, read_exif
from pinstack.push.raws import RawOptions, convert, recipe_of

rawpy = pytest.importorskip("rawpy")
numpy = pytest.importorskip("numpy")
tifffile = pytest.importorskip("tifffile")
image = pytest.importorskip("PIL.Image")

TIFF = RawOptions()


def nothing() -> None:
    pass


def encoded(light: float) -> float:
    """The sample of 16 bits of sRGB (IEC 61966-2-1)."""
    return 65535 * (12.92 * light if light <= 0.0031308 else 1.055 * light ** (1 / 2.4) - 0.055)


def linear(samples: Any, most: int = 65535) -> Any:
    value = numpy.asarray(samples, dtype=float) / most
    return numpy.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def converted(dng: Dng, reference: Optional[Dng] = None, options: RawOptions = TIFF) -> bytes:
    """The picture of a file in a stack with this reference slice."""
    recipe = recipe_of(Path("ref.dng"), (reference or dng).bytes(), options)
    to = io.BytesIO()
    convert(Path("a.dng"), dng.bytes(), recipe, to, nothing)
    return to.getvalue()


def pixels(tiff: bytes) -> Any:
    return tifffile.imread(io.BytesIO(tiff))


def close(found: Any, expected: float, most: float = 3) -> bool:
    return bool(numpy.all(numpy.abs(numpy.asarray(found, dtype=float) - expected) <= most))


@pytest.mark.parametrize("light", [0.001, 0.02, 0.18, 0.5, 0.9])
@pytest.mark.parametrize("order", ["<", ">"])
def test_grey_keeps_its_value_in_srgb(light: float, order: str) -> None:
    found = pixels(converted(Dng(light=lambda x, y: light, order=order)))
    assert found.shape == (48, 64, 3) and found.dtype == numpy.uint16
    # a sample of the sensor is 1 / 15359 of the range
    step = encoded(light + 1 / 15359) - encoded(light)
    assert close(found, encoded(light), 3 + 2 * step)


def test_a_file_twice_as_bright_is_twice_as_bright_in_linear_light() -> None:
    dark = Dng(light=lambda x, y: 0.05 + 0.3 * x / 64)
    bright = Dng(light=lambda x, y: 2 * dark.light(x, y))
    one, two = (linear(pixels(converted(dng, dark))) for dng in (dark, bright))
    assert numpy.allclose(two[4:-4, 4:-4] / one[4:-4, 4:-4], 2, rtol=2e-3)
    # the content decides nothing: a highlight changes nothing elsewhere
    lamp = Dng(light=lambda x, y: 1.0 if x > 58 else dark.light(x, y))
    assert (pixels(converted(lamp, dark))[:, :48] == pixels(converted(dark))[:, :48]).all()


def test_the_white_balance_is_that_of_the_reference_slice() -> None:
    reference = Dng()
    # the same light and sensor, but the camera took another white for granted
    wrong = Dng(neutral=(0.9, 1.0, 0.4), real=reference.neutral)
    assert (pixels(converted(wrong, reference)) == pixels(converted(reference))).all()
    own = pixels(converted(wrong)).reshape(-1, 3).mean(0)
    assert own[2] > 1.2 * own[0], "with its own white balance it has a cast"


def test_black_is_that_of_the_file_and_the_scale_that_of_the_reference() -> None:
    reference = Dng(light=lambda x, y: 0.5)
    # the same light with another black level: its samples are 88 higher
    shifted = Dng(light=lambda x, y: 0.5, black=600, white=600 + 15359)
    # a camera that states another white for the same samples
    stated = Dng(light=lambda x, y: 0.5 * 15359 / 14000, black=512, white=14512)
    for other in (shifted, stated):
        assert close(pixels(converted(other, reference)), encoded(0.5))
    assert not close(pixels(converted(stated)), encoded(0.5), 500)


def test_highlights_are_clipped_to_white() -> None:
    assert close(pixels(converted(Dng(light=lambda x, y: 1.0))), 65535, 20)
    assert (pixels(converted(Dng(light=lambda x, y: 1.3, white=12000))) == 65535).all()


@pytest.mark.parametrize("stops", [1.0, -1.0])
def test_the_exposure_is_the_same_factor_for_all(stops: float) -> None:
    found = pixels(converted(Dng(light=lambda x, y: 0.1), options=RawOptions(exposure=stops)))
    assert close(found, encoded(0.1 * 2**stops), 40)


def test_the_pixels_are_those_of_the_sensor_and_the_tag_that_of_the_camera() -> None:
    def light(x: int, y: int) -> float:
        return 0.5 if x < 32 and y < 24 else 0.1

    upright = pixels(converted(Dng(light=light)))
    for orientation in (1, 3, 6, 8):
        made = converted(Dng(light=light, orientation=orientation))
        # tifffile applies no orientation
        assert (pixels(made) == upright).all() and tags(made)["Orientation"] == orientation
    assert upright[10, 10, 1] > 2 * upright[10, 50, 1] and upright[40, 10, 1] < upright[10, 10, 1]


def test_the_part_that_the_camera_names_is_kept() -> None:
    whole = Dng(light=lambda x, y: x / 100)
    part = pixels(converted(Dng(light=lambda x, y: x / 100, border=4)))
    assert (part == pixels(converted(whole))[4:-4, 4:-4]).all()


def tags(tiff: bytes) -> Dict[str, Any]:
    with tifffile.TiffFile(io.BytesIO(tiff)) as file:
        return {tag.name: tag.value for tag in file.pages[0].tags.values()}


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("kind", ["tiff", "jpeg"])
def test_exif_is_kept_and_names_the_conversion(order: str, kind: str) -> None:
    dng = Dng(order=order, orientation=6, more={40000: (ASCII, "not known")})
    made = converted(dng, options=RawOptions(format=kind))
    with image.open(io.BytesIO(made)) as opened:
        main = dict(opened.getexif())
        exif = dict(opened.getexif().get_ifd(0x8769))
    assert (main[271], main[272], main[274], main[315]) == ("Lab", "Bench 1", 6, "Ada")
    assert main[306] == "2026:11:24 09:00:00" and main[50708] == "Lab Bench 1"
    assert main[305].startswith("pinstack ") and "LibRaw" in main[305]
    assert not {40000, 50706, 50728, 33422} & set(main), "it would look like a raw file"
    assert (exif[36867], exif[37521], exif[34855]) == ("2026:11:23 10:00:00", "25", 200)
    assert (float(exif[37386]), float(exif[33434]), exif[42036]) == (65.0, 1 / 60, "Macro 65mm f/2.8")
    assert exif[0xA001] == 1 and 37500 not in exif
    comment = exif[0x9286]
    told = json.loads((comment if isinstance(comment, bytes) else comment.encode())[8:])
    assert told["reference"] == "ref.dng" and told["white_balance"] == [2.0, 1.0, 1.6, 1.0]
    assert (told["range"], told["format"], told["gamma"], told["exposure"]) == (15359, kind, "sRGB", 0.0)


def test_jpeg_has_the_values_of_tiff_with_8_bits() -> None:
    dng = Dng(light=lambda x, y: 0.05 + 0.5 * x / 64)
    with image.open(io.BytesIO(converted(dng, options=RawOptions(format="jpeg", quality=100)))) as opened:
        jpeg = numpy.asarray(opened)
    difference = jpeg - pixels(converted(dng)) // 256
    assert abs(difference[4:-4, 4:-4]).max() <= 1
    best, small = (len(converted(dng, options=RawOptions("jpeg", quality))) for quality in (100, 30))
    assert small < best


def test_the_same_file_gives_the_same_bytes() -> None:
    dng = Dng(light=lambda x, y: (x * 7 + y * 13) % 50 / 100)
    assert converted(dng) == converted(dng)


def damaged() -> List[bytes]:
    whole = Dng().bytes()
    return [b"", b"not a raw file" * 99, whole[: len(whole) - 2000], whole[:300]]


@pytest.mark.parametrize("data", damaged(), ids=["empty", "foreign", "short", "head alone"])
def test_a_damaged_file_is_refused_with_its_name_and_what_to_do(data: bytes) -> None:
    recipe = recipe_of(Path("ref.dng"), Dng().bytes(), TIFF)
    for call in (
        lambda: recipe_of(Path("torn.dng"), data, TIFF),
        lambda: convert(Path("torn.dng"), data, recipe, io.BytesIO(), nothing),
    ):
        with pytest.raises(PinstackError, match=r"torn\.dng .*copy it again") as caught:
            call()
        assert caught.value.code == "invalid_source"


def test_a_file_of_another_size_is_refused() -> None:
    with pytest.raises(PinstackError, match=r"a\.dng has 32 x 48 px, but ref\.dng has 64 x 48 px"):
        converted(Dng(width=32), Dng())


def test_times_are_those_of_the_exif_data(tmp_path: Path) -> None:
    times = [time_taken(Dng(order=order).write(tmp_path / "a.dng")) for order in "<>"]
    assert times[0] == times[1] and times[0] is not None and times[0] % 1 == 0.25


def boxed(dng: Dng) -> bytes:
    """The EXIF data as Canon stores them in CR3: both directories as TIFF structures of their own."""
    from pinstack.push.exif import _directory

    exif = read_exif(io.BytesIO(dng.bytes()))
    assert exif is not None
    parts = [b"\0\0\0\x18ftypcrx \0\0\0\1crx isom"]
    for name, entries in ((b"CMT1", exif.main), (b"CMT2", exif.exif)):
        kept = {tag: entry for tag, entry in entries.items() if tag != 0x8769}
        body = b"II*\0\x08\0\0\0" + _directory("<", kept, 8)
        parts.append((len(body) + 8).to_bytes(4, "big") + name + body)
    return b"".join(parts)


def test_exif_is_found_in_the_containers_of_canon_and_fujifilm() -> None:
    jpeg = converted(Dng(), options=RawOptions(format="jpeg"))
    raf = b"FUJIFILMCCD-RAW ".ljust(84, b"\0") + (200).to_bytes(4, "big")
    for data in (jpeg, raf.ljust(200, b"\0") + jpeg, boxed(Dng())):
        found = read_exif(io.BytesIO(data))
        assert found is not None and found.text(0x9003) == "2026:11:23 10:00:00"
        assert found.main[0x0110].value == b"Bench 1\0"
    assert read_exif(io.BytesIO(b"II*\0\xff\xff\xff\x7f")) is None


def test_without_exif_the_orientation_is_that_of_libraw() -> None:
    from pinstack.push.exif import for_picture

    assert for_picture(Exif(), 8, "s", "c").main[0x0112].value == b"\x08\0"


def test_memory_is_shared_and_waiting_can_be_ended() -> None:
    memory, at_once, most, lock = Memory(100), 0, 0, threading.Lock()
    both = threading.Barrier(2)

    def use(size: int) -> None:
        nonlocal at_once, most
        with memory.taken(size, nothing):
            with lock:
                at_once += 1
                most = max(most, at_once)
            if size == 50:
                both.wait(10)
            with lock:
                at_once -= 1

    for sizes in ([50, 50], [200, 60, 60]):
        most = 0
        threads = [threading.Thread(target=use, args=(size,)) for size in sizes]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert most == (2 if sizes[0] == 50 else 1)

    def end() -> None:
        raise KeyboardInterrupt

    with memory.taken(100, nothing), pytest.raises(KeyboardInterrupt), memory.taken(1, end):
        pass


def test_the_first_failure_ends_the_conversion_of_its_stack(tmp_path: Path) -> None:
    files = [Dng().write(tmp_path / f"{at}.dng") for at in range(6)]
    files[2].write_bytes(b"torn")
    source = StoredZip(Member.of(path, path.name) for path in files)
    converter = Converter(4.0, TIFF)
    recipe = converter.recipe(source, 0, nothing)
    targets = {at: tmp_path / f"{at}.tif" for at in range(6)}
    with pytest.raises(PinstackError, match=r"2\.dng"):
        converter.convert(source, recipe, targets, lambda done: None)
    assert not targets[2].exists()
    for made in tmp_path.glob("*.tif"):
        assert pixels(made.read_bytes()).shape == (48, 64, 3)


# -- the command ----------------------------------------------------------------------------------------------------


def rig(root: Path, count: int = 3) -> Path:
    """Two stacks of both lights: the middle slice of the front light alone has the right white."""
    for view in ("view_01", "view_02"):
        for light in ("front", "Gegenlicht"):
            for at in range(1, count + 1):
                is_reference = light == "front" and at == count // 2 + 1
                neutral = (0.5, 1.0, 0.625) if is_reference else (0.8, 1.0, 0.5 + at / 100)
                dng = Dng(neutral=neutral, real=(0.5, 1.0, 0.625), light=lambda x, y, at=at: 0.1 * at)  # type: ignore[misc]
                dng.write(root / view / light / f"DSC_{at + 8}.DNG")
    return root


def test_convert_writes_the_same_layout_and_converts_stacks_alike(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = rig(tmp_path / "shots")
    (root / "view_01/front/DSC_9.JPG").write_bytes(b"beside it")
    assert main(["convert", str(root)]) == 0
    out = tmp_path / "shots-converted"
    names = sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())
    lights_of = [f"{view}/{light}" for view in ("view_01", "view_02") for light in ("Gegenlicht", "front")]
    assert names == [f"{light}/DSC_{n}.tif" for light in lights_of for n in ("10", "11", "9")]
    for light in lights_of:
        for at in (1, 2, 3):
            assert close(pixels((out / light / f"DSC_{at + 8}.tif").read_bytes()), encoded(0.1 * at), 6)
    told = capsys.readouterr().err
    assert "view_01: 6 files, with the white balance of DSC_10.DNG" in told and "2 of 2 stacks" in told


def test_convert_overwrites_only_by_force(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root, out = rig(tmp_path / "shots"), tmp_path / "out"
    command = ["convert", str(root), "-o", str(out), "--format", "jpeg", "--quality", "80", "--memory-gb", "0.1"]
    assert main(command) == 0 and (out / "view_02/front/DSC_9.jpg").stat().st_size > 0
    (out / "view_02/front/DSC_9.jpg").write_bytes(b"mine")
    assert main(command) == 2 and "--force" in capsys.readouterr().err
    assert (out / "view_02/front/DSC_9.jpg").read_bytes() == b"mine"
    assert main([*command, "--force"]) == 0 and (out / "view_02/front/DSC_9.jpg").read_bytes() != b"mine"


def test_convert_goes_on_after_a_stack_that_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = rig(tmp_path / "shots")
    whole = (root / "view_01/front/DSC_9.DNG").read_bytes()
    (root / "view_01/front/DSC_9.DNG").write_bytes(whole[:-3000])
    assert main(["convert", str(root)]) == 1
    told = capsys.readouterr().err
    assert re.search(r"view_01: failed: .*DSC_9\.DNG .*copy it again", told) and "1 of 2 stacks" in told
    out = tmp_path / "shots-converted"
    assert not (out / "view_01/front/DSC_9.tif").exists() and len(list((out / "view_02").rglob("*.tif"))) == 6
    assert not list(out.rglob("*.part"))


def test_several_folders_have_one_each_in_the_result(tmp_path: Path) -> None:
    for name in ("a", "b"):
        Dng().write(tmp_path / name / "1.dng")
    assert main(["convert", str(tmp_path / "a"), str(tmp_path / "b"), "-o", str(tmp_path / "out")]) == 0
    assert sorted(path.parent.name for path in (tmp_path / "out").rglob("*.tif")) == ["a", "b"]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--quality", "0"], "1 to 100"),
        (["--memory-gb", "0"], "memory"),
        (["--exposure", "9"], "-4 to 4"),
        ([], "no camera"),
    ],
)
def test_wrong_usage_of_convert(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: List[str], reason: str
) -> None:
    (tmp_path / "a.jpg").write_bytes(b"")
    assert main(["convert", str(tmp_path), *arguments]) == 2 and reason in capsys.readouterr().err


def test_convert_says_what_to_install(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    Dng().write(tmp_path / "a.dng")
    monkeypatch.setattr(raws, "is_supported", lambda: False)
    assert main(["convert", str(tmp_path)]) == 2
    assert "python -m pip install rawpy pillow" in capsys.readouterr().err


def test_the_service_and_the_client_know_the_same_names() -> None:
    rust = (PROJECT / "science/src/imaging/codec/sniff.rs").read_text("utf-8")
    listed = re.search(r"const RAW: .*?\];", rust, re.DOTALL)
    assert listed is not None and {f".{name}" for name in re.findall(r'\("(\w+)",', listed[0])} == raws.RAWS
    rust = (PROJECT / "science/src/archive/light.rs").read_text("utf-8")
    for name, words in (("FRONT", lights.FRONT), ("BACK", lights.BACK)):
        lines = re.search(rf"const {name}: .*? = \[(.*?)\];", rust, re.DOTALL)
        assert lines is not None and set(" ".join(re.findall(r'"([^"]+)"', lines[1])).split()) == words
    assert lights.is_back(Path("v/Contre-Jour/1.nef")) and lights.is_back(Path("v/arri\u00e8re/1.nef"))

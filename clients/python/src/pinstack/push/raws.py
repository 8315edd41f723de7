"""Camera raw files: which names they have, and how one becomes a picture.

In: the bytes of a raw file, and the :class:`Recipe` of its stack. Out: a TIFF of 16 bits or a JPEG, in sRGB. LibRaw
decodes the file; it comes with the package rawpy, the extra ``raw``.

All slices of a stack, of both lights, have one recipe, so equal light becomes equal values:

| | |
|---|---|
| demosaicing | AHD (X-Trans sensors: the method of LibRaw for them), without noise reduction |
| white balance | as shot of the reference slice |
| scale | ``(sample - black) / range``; ``black`` is that of the file, ``range`` white minus black of the reference |
| brightness | ``2 ** exposure`` for all; nothing is derived from the content of a picture |
| highlights | clipped at ``range`` |
| orientation | that of the sensor; the tag of the camera is kept, as in its JPEG files, and the service applies it |
| size | the part that the camera names; a JPEG of the camera shows it too |
"""

from __future__ import annotations

import contextlib
import errno
import importlib.util
import io
import json
from dataclasses import asdict, dataclass
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, BinaryIO, Callable, Dict, Iterator, List, Sequence, Tuple

from .._errors import PinstackError
from .._version import VERSION
from .._zips import is_picture
from .exif import Exif, block, for_picture, read_exif
from .tiff import write_tiff

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: Extensions of camera raw files. The service has the same list.
RAWS = frozenset(
    {".cr2", ".cr3", ".crw", ".nef", ".nrw", ".arw", ".srf", ".sr2", ".dng", ".orf", ".rw2", ".raf", ".pef", ".srw",
     ".3fr", ".iiq", ".x3f", ".raw"}
)  # fmt: skip
#: File endings by format.
SUFFIXES = {"tiff": ".tif", "jpeg": ".jpg"}
#: Said where rawpy is missing.
INSTALL = "to convert camera raw files, install rawpy and pillow (the extra 'raw'): python -m pip install rawpy pillow"
#: The values of the tag of EXIF for those of LibRaw.
ORIENTATIONS = {0: 1, 3: 3, 5: 8, 6: 6}
#: The curve of sRGB: its power, and its slope in the dark.
SRGB = (2.4, 12.92)
#: Memory of a conversion: bytes per pixel (sensor 2, four colours 8, picture 6, and room), and bytes beside them.
BYTES_PER_PIXEL, BYTES_BESIDE = 20, 64 << 20


@dataclass(frozen=True)
class RawOptions:
    """What people choose."""

    #: ``tiff`` or ``jpeg``.
    format: str = "tiff"
    #: Of JPEG, 1 to 100.
    quality: int = 95
    #: Stops by which all slices are made brighter, or darker if negative.
    exposure: float = 0.0

    def check(self) -> None:
        """Raises ``invalid_source`` for a value out of range."""
        if self.format not in SUFFIXES:
            raise PinstackError("invalid_source", f"the format is {self.format!r}; it must be tiff or jpeg")
        if not 1 <= self.quality <= 100:
            raise PinstackError("invalid_source", f"the quality is {self.quality}; it must be 1 to 100")
        if not -4 <= self.exposure <= 4:
            raise PinstackError("invalid_source", f"the exposure is {self.exposure:g} stops; it must be -4 to 4")

    @property
    def suffix(self) -> str:
        """The ending of converted files."""
        return SUFFIXES[self.format]


@dataclass(frozen=True)
class Recipe:
    """What the slices of a stack have in common."""

    options: RawOptions
    #: The reference slice.
    reference: str
    #: Factors of red, green, blue and the second green.
    white_balance: Tuple[float, ...]
    #: White minus black, of the samples.
    range: int
    #: Of the pictures, px.
    width: int
    height: int

    def memory(self, size: int) -> int:
        """Bytes that the conversion of a file of ``size`` bytes takes at most."""
        return BYTES_PER_PIXEL * self.width * self.height + size + BYTES_BESIDE

    def disk(self) -> int:
        """Bytes that a converted file takes at most; far more than JPEG files ever have."""
        return self.width * self.height * (6 if self.options.format == "tiff" else 3) + (1 << 20)

    def comment(self) -> str:
        """The settings as JSON; each converted file has them in its EXIF data."""
        told: Dict[str, Any] = {"conversion": versions(), "demosaicing": "AHD", "gamma": "sRGB", **asdict(self)}
        told.update(told.pop("options"))
        return json.dumps(told)


def is_raw(path: PurePath) -> bool:
    """Whether a file of this name is a camera raw file."""
    return path.suffix.lower() in RAWS


def is_supported() -> bool:
    """Whether raw files can be converted here."""
    return importlib.util.find_spec("rawpy") is not None and importlib.util.find_spec("PIL") is not None


def require_support() -> None:
    """Raises ``invalid_source`` with what to install."""
    if not is_supported():
        raise PinstackError("invalid_source", INSTALL)


def versions() -> str:
    """The programs whose versions decide the bytes of a converted file."""
    import rawpy

    libraw = ".".join(str(part) for part in rawpy.libraw_version)
    return f"pinstack {VERSION}, LibRaw {libraw}"


def one_of_each_shot(
    files: Sequence[Path], prefers_raw: bool, supported: bool
) -> Tuple[List[Path], List[Tuple[Path, str]]]:
    """The files without those that show the same shot as another: a folder may have ``a.ARW`` and ``a.JPG``.

    Returns the others too, each with the reason.
    """
    raws: Dict[Tuple[Path, str], Path] = {}
    pictures: Dict[Tuple[Path, str], Path] = {}
    for path in files:
        if is_raw(path) or is_picture(path):
            (raws if is_raw(path) else pictures).setdefault((path.parent, path.stem.casefold()), path)
    kept: List[Path] = []
    left_out: List[Tuple[Path, str]] = []
    for path in files:
        shot = (path.parent, path.stem.casefold())
        raw, picture = raws.get(shot), pictures.get(shot)
        is_shot = is_raw(path) or is_picture(path)
        if not is_shot or raw is None or (picture is None and path == raw):
            kept.append(path)
        elif is_raw(path) and path != raw:
            left_out.append((path, f"another raw file of the same name is used, {raw.name}"))
        elif is_raw(path) == prefers_raw:
            kept.append(path)
        elif is_raw(path):
            why = "" if supported else f"; {INSTALL}"
            left_out.append((path, f"the picture of the same name is used{why}"))
        else:
            left_out.append((path, f"the raw file of the same name is used, {raw.name}"))
    return kept, left_out


def recipe_of(path: Path, data: bytes, options: RawOptions) -> Recipe:
    """The recipe of the stack whose reference slice is the raw file ``path`` with the content ``data``."""
    with _opened(path, data) as raw:
        balance = list(raw.camera_whitebalance)
        if min(balance[:3]) <= 0:
            # the file does not say it
            balance = list(raw.daylight_whitebalance)
        balance[3] = balance[3] if balance[3] > 0 else balance[1]
        _, _, width, height = _part(raw.sizes)
        white = int(raw.white_level) - min(raw.black_level_per_channel)
        return Recipe(options, path.name, tuple(round(one, 6) for one in balance), white, width, height)


def convert(path: Path, data: bytes, recipe: Recipe, to: BinaryIO, check: Callable[[], None]) -> None:
    """Writes the picture of a raw file. ``check`` is called between the steps; it may raise to end them.

    Raises ``invalid_source`` for a file that LibRaw cannot read, or of another size than the reference slice.
    """
    import rawpy

    check()
    with _opened(path, data) as raw:
        left, top, width, height = _part(raw.sizes)
        if (width, height) != (recipe.width, recipe.height):
            detail = (
                f"{path} has {width} x {height} px, but {recipe.reference} has {recipe.width} x {recipe.height} px; "
                "set the camera to one size, or take the file away if it is no slice"
            )
            raise PinstackError("invalid_source", detail)
        check()
        pixels = raw.postprocess(
            rawpy.Params(
                demosaic_algorithm=rawpy.DemosaicAlgorithm.AHD,
                user_wb=list(recipe.white_balance),
                # LibRaw sets it after it has subtracted the black of the file
                user_sat=recipe.range,
                # LibRaw would take the brightest sample of a picture for white
                adjust_maximum_thr=0.0,
                no_auto_bright=True,
                bright=2.0**recipe.options.exposure,
                highlight_mode=rawpy.HighlightMode.Clip,
                output_color=rawpy.ColorSpace.sRGB,
                gamma=SRGB,
                output_bps=16 if recipe.options.format == "tiff" else 8,
                user_flip=0,
            )
        )
        check()
        exif = for_picture(
            read_exif(io.BytesIO(data)) or Exif(),
            ORIENTATIONS.get(raw.sizes.flip, 1),
            versions(),
            recipe.comment(),
        )
        part = pixels[top : top + height, left : left + width]
        if recipe.options.format == "tiff":
            write_tiff(to, part, exif, check)
        else:
            _write_jpeg(to, part, exif, recipe.options.quality)


def _part(sizes: Any) -> Tuple[int, int, int, int]:
    """The part of the developed picture that the camera names: left, top, width, height."""
    # rawpy before 0.25 does not tell it
    width, height = getattr(sizes, "crop_width", 0), getattr(sizes, "crop_height", 0)
    if width and height:
        left, top = sizes.crop_left_margin - sizes.left_margin, sizes.crop_top_margin - sizes.top_margin
        if left >= 0 and top >= 0 and left + width <= sizes.iwidth and top + height <= sizes.iheight:
            return left, top, width, height
    return 0, 0, sizes.iwidth, sizes.iheight


def _write_jpeg(to: BinaryIO, pixels: NDArray[Any], exif: Exif, quality: int) -> None:
    from PIL import Image

    grey = pixels[:, :, 0] if pixels.shape[2] == 1 else pixels
    # colour at full resolution
    Image.fromarray(grey).save(to, "JPEG", quality=quality, subsampling=0, exif=block(exif))


@contextlib.contextmanager
def _opened(path: Path, data: bytes) -> Iterator[Any]:
    """The raw file, decoded. Raises ``invalid_source`` with what to do."""
    require_support()
    import rawpy

    raw = rawpy.RawPy()
    try:
        raw.open_buffer(io.BytesIO(data))
        raw.unpack()
        yield raw
    except (rawpy.LibRawUnsufficientMemoryError, MemoryError) as error:
        reason = "not enough memory to convert it; convert fewer files at once (--raw-memory-gb, --memory-gb)"
        raise OSError(errno.ENOMEM, reason, str(path)) from error
    except rawpy.LibRawFatalError as error:
        detail = f"{path} is damaged, or ends before the picture does; copy it again from the camera"
        raise PinstackError("invalid_source", detail) from error
    except (rawpy.LibRawError, rawpy.NotSupportedError) as error:
        detail = (
            f"{path} is no raw file that {versions().split(', ')[1]} reads: it is damaged, or its camera is newer; "
            "copy it again, update with 'python -m pip install -U rawpy', or convert it to DNG"
        )
        raise PinstackError("invalid_source", detail) from error
    finally:
        raw.close()

"""numpy arrays of results, and of homographies. Needs the extra ``numpy``."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Mapping

from ._errors import PinstackError

if TYPE_CHECKING:
    import numpy
    from numpy.typing import NDArray


def homographies(profile: Mapping[str, Any]) -> NDArray[numpy.float64]:
    """The homographies of a profile, ``N x 3 x 3``; each maps a slice pixel to a reference-slice pixel."""
    import numpy

    return numpy.array(profile["homographies"], dtype=numpy.float64).reshape(-1, 3, 3)


def rows(matrices: Any) -> Any:
    """Homographies as lists of nine numbers: from an array ``N x 3 x 3`` or ``N x 9``, or from lists."""
    listed = matrices.tolist() if hasattr(matrices, "tolist") else matrices
    flat = []
    for matrix in listed:
        one = matrix.tolist() if hasattr(matrix, "tolist") else list(matrix)
        flat.append([float(v) for row in one for v in row] if len(one) == 3 else [float(v) for v in one])
    return flat


def picture(tiff: bytes) -> NDArray[Any]:
    """The samples of a TIFF: ``H x W`` or ``H x W x channels``, 8 or 16 bits, nothing converted."""
    import tifffile

    array: NDArray[Any] = tifffile.imread(io.BytesIO(tiff))
    return array


def heights(values: NDArray[Any], info: Mapping[str, Any]) -> NDArray[numpy.float64]:
    """The heights of a height map in its unit; NaN where there is none."""
    import numpy

    measured = info["offset"] + (values.astype(numpy.float64) - 1) * info["scale"]
    return numpy.where(values == info["invalid"], numpy.nan, measured)


def sigmas(values: NDArray[Any], info: Mapping[str, Any]) -> NDArray[numpy.float64]:
    """The standard deviations of the heights in the same unit; NaN where there is none."""
    import numpy

    return numpy.where(values == info["invalid"], numpy.nan, values.astype(numpy.float64) * info["scale"])


def height_info(stack: Mapping[str, Any]) -> Mapping[str, Any]:
    """How to read the height map of a stack."""
    info = stack.get("height")
    if not isinstance(info, dict):
        detail = "the stack has no height map; fuse it with height='auto'"
        raise PinstackError("no_result", detail)
    return info

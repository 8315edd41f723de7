"""Aligns the photographed stacks of a folder, for the bench `stack`: align.py FOLDER (needs opencv-python-headless).

Each stack is a folder of JPEG files, in the order of their names. Neighbours are registered by an affine ECC transform
(Evangelidis & Psarakis, IEEE TPAMI 2008), and the transforms are chained to the middle slice. Beside this script, each
stack gets a profile as `PUT /v1/profiles/{rig}/{lens}` takes it.
"""

import json
import pathlib
import sys

import cv2
import numpy as np

STACKS = ["newto12", "pcb_depth10", "pcb7", "flies9", "coffee6"]
LARGEST_SIDE = 1000  # of the pictures that are registered, px
STEPS = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-7)


def neighbour(to: np.ndarray, of: np.ndarray, scale: float) -> np.ndarray:
    """The affine transform from pixels of `of` to those of `to`, both reduced by `scale`."""
    warp = np.eye(2, 3, dtype=np.float32)
    _, warp = cv2.findTransformECC(to, of, warp, cv2.MOTION_AFFINE, STEPS, None, 5)
    backward = np.vstack([warp, [0, 0, 1]]).astype(float)
    # pixel centres are whole numbers at both sizes
    reduce = np.array([[scale, 0, (scale - 1) / 2], [0, scale, (scale - 1) / 2], [0, 0, 1]])
    return np.linalg.inv(np.linalg.inv(reduce) @ backward @ reduce)


def profile(folder: pathlib.Path) -> dict:
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() == ".jpg" and path.stem != "expected")
    pictures = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION) for path in files]
    height, width = pictures[0].shape
    scale = min(1.0, LARGEST_SIDE / max(width, height))
    size = (round(width * scale), round(height * scale))
    reduced = [cv2.resize(picture, size, interpolation=cv2.INTER_AREA) for picture in pictures]
    reference = len(files) // 2
    matrices = [np.eye(3)] * len(files)
    for i in range(reference + 1, len(files)):
        matrices[i] = matrices[i - 1] @ neighbour(reduced[i - 1], reduced[i], scale)
    for i in range(reference - 1, -1, -1):
        matrices[i] = matrices[i + 1] @ neighbour(reduced[i + 1], reduced[i], scale)
    return {
        "image_width": width,
        "image_height": height,
        "reference_index": reference,
        "capture_mode": "fixed_lens",
        "homographies": [[round(float(value), 9) for value in matrix.ravel()] for matrix in matrices],
    }


for stack in STACKS:
    text = json.dumps(profile(pathlib.Path(sys.argv[1]) / stack)).replace("]], ", "]],\n").replace("], [", "],\n[")
    path = pathlib.Path(__file__).with_name(f"{stack}.json")
    path.write_text(text + "\n")
    print(path)

"""Cameras of a case: what COLMAP found, and the truth that the bundle holds.

Pixel coordinates have the centre of the top-left pixel at (0, 0). A pose maps world to camera: x = R X + t.
"""

import dataclasses
import pathlib
import subprocess
import tempfile

import cv2
import numpy as np


@dataclasses.dataclass
class View:
    """One picture and its pose."""

    name: str
    rotation: np.ndarray
    translation: np.ndarray

    @property
    def centre(self):
        """The centre of projection in the world."""
        return -self.rotation.T @ self.translation


@dataclasses.dataclass
class Model:
    """Pinhole camera, views, and the points that COLMAP triangulated."""

    camera: np.ndarray
    views: list
    points: np.ndarray


def read_text(folder):
    """Reads cameras.txt, images.txt and points3D.txt."""
    _, kind, _, _, *parameters = lines(folder / "cameras.txt")[0].split()
    if kind != "PINHOLE":
        raise SystemExit(f"{folder}: the camera model is {kind}; this script knows PINHOLE alone")
    fx, fy, cx, cy = map(float, parameters)
    # COLMAP counts from the corner of the top-left pixel
    camera = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
    views = []
    # the second line of each image lists its observations
    for line in lines(folder / "images.txt", keep_empty=True)[::2]:
        fields = line.split()
        w, *v = map(float, fields[1:5])
        views.append(View(fields[9], of_quaternion(w, np.array(v)), np.array(fields[5:8], float)))
    points = [line.split()[1:4] for line in lines(folder / "points3D.txt")]
    return Model(camera, sorted(views, key=lambda view: view.name), np.array(points, float).reshape(-1, 3))


def lines(path, keep_empty=False):
    """The lines of a file without its comments."""
    found = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    while found and not found[-1].strip() and not found[-2].strip():
        found.pop()
    return found if keep_empty else [line for line in found if line.strip()]


def of_quaternion(w, v):
    """The rotation matrix of a quaternion."""
    axis = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + 2 * w * axis + 2 * axis @ axis


def similarity(source, target):
    """Scale, rotation and shift that map points to points with least squares (Umeyama 1991)."""
    mean_source, mean_target = source.mean(0), target.mean(0)
    a, b = source - mean_source, target - mean_target
    left, sizes, right = np.linalg.svd(b.T @ a)
    sign = np.diag([1, 1, np.sign(np.linalg.det(left @ right))])
    rotation = left @ sign @ right
    scale = (sizes * np.diag(sign)).sum() / (a**2).sum()
    return scale, rotation, mean_target - scale * rotation @ mean_source


def truth(folder):
    """The true cameras, in mm, which every bundle for COLMAP of a turntable holds."""
    return read_text(folder / "sparse/0")


def found(folder):
    """The cameras that COLMAP found, in the coordinates of the true ones: aligned by the centres of projection alone.

    Also returns the root mean square distance of the aligned centres from the true ones, mm.
    """
    with tempfile.TemporaryDirectory() as text:
        command = ["colmap", "model_converter", "--input_path", folder / "model/0", "--output_path", text]
        subprocess.run([*command, "--output_type", "TXT"], check=True, stdout=subprocess.DEVNULL)
        model = read_text(pathlib.Path(text))
    true = {view.name: view.centre for view in truth(folder).views}
    centres = np.array([view.centre for view in model.views])
    targets = np.array([true[view.name] for view in model.views])
    scale, rotation, shift = similarity(centres, targets)
    views = []
    for view in model.views:
        turned = view.rotation @ rotation.T
        views.append(View(view.name, turned, scale * view.translation - turned @ shift))
    error = np.array([view.centre for view in views]) - targets
    points = scale * model.points @ rotation.T + shift
    return Model(model.camera, views, points), float(np.sqrt((error**2).sum(1).mean()))


def pictures(folder, views):
    """Luminance and mask of each view, as floats 0..255 and 0..1."""
    grey = [cv2.imread(str(folder / "images" / view.name), cv2.IMREAD_GRAYSCALE) for view in views]
    masks = [cv2.imread(str(folder / "masks" / f"{view.name}.png"), cv2.IMREAD_GRAYSCALE) for view in views]
    return [picture.astype(np.float32) for picture in grey], [(mask > 127).astype(np.float32) for mask in masks]

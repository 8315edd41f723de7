"""Meshes of reconstruct.py against the true surface. See docs/POSES.md.

Usage: python3 compare.py PICTURE.png FOLDER...
Prints a table: distances in percent of the size of the object, which is the longest side of its box. Nothing is moved:
the meshes are where the centres of projection put them. The picture shows the truth and then each mesh in the order of
the folders, red where it is 2 % of the size away from the truth.
"""

import pathlib
import sys

import cv2
import model
import numpy as np
import open3d as o3d

SAMPLES = 200_000
# a part of the true surface counts if so many cameras see it, not more slanted than this
SEEN_BY, LEAST_COSINE = 3, 0.25
# the view of the picture: none of those that were taken
PAN_DEG, TILT_DEG = 50.0, 25.0
SIDE_PX, RED_AT_PERCENT = 300, 2.0


def scene_of(mesh):
    """For rays and distances."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(mesh))
    return scene


def distance(scene, points):
    """Distance of points from the triangles."""
    return scene.compute_distance(np.ascontiguousarray(points, np.float32)).numpy()


def sampled(mesh):
    """Points evenly spread over the triangles, and the normals there."""
    mesh.compute_triangle_normals()
    o3d.utility.random.seed(1)
    cloud = mesh.sample_points_uniformly(SAMPLES, use_triangle_normal=True)
    return np.asarray(cloud.points), np.asarray(cloud.normals)


def seen_by(scene, points, normals, centres):
    """How many cameras see each point."""
    count = np.zeros(len(points), int)
    for centre in centres:
        towards = centre - points
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        rays = np.hstack([points + 0.02 * towards, towards]).astype(np.float32)
        free = ~np.isfinite(scene.cast_rays(rays)["t_hit"].numpy())
        count += free & ((normals * towards).sum(1) >= LEAST_COSINE)
    return count


def rendered(mesh, middle, size, truth=None):
    """A picture of the mesh around a point, coloured by its distance from the truth."""
    pan, tilt = np.radians([PAN_DEG, TILT_DEG])
    back = np.array([np.cos(tilt) * np.cos(pan), np.cos(tilt) * np.sin(pan), np.sin(tilt)])
    right = np.array([-np.sin(pan), np.cos(pan), 0])
    up = np.cross(back, right)
    steps = (np.arange(2 * SIDE_PX) + 0.5) / (2 * SIDE_PX) - 0.5
    x, y = np.meshgrid(1.2 * size * steps, -1.2 * size * steps)
    starts = middle + 100 * back + x[..., None] * right + y[..., None] * up
    rays = np.concatenate([starts, np.broadcast_to(-back, starts.shape)], -1).astype(np.float32)
    hit = scene_of(mesh).cast_rays(rays)
    depths, normals = hit["t_hit"].numpy(), hit["primitive_normals"].numpy()
    met = np.isfinite(depths)
    light = back + 0.5 * up - 0.4 * right
    shade = 0.25 + 0.7 * np.abs(normals @ (light / np.linalg.norm(light)))
    picture = np.full((*depths.shape, 3), 255.0)
    picture[met] = 235 * shade[met, None]
    if truth is not None:
        points = starts[met] - depths[met, None] * back
        wrong = np.clip(100 * distance(truth, points) / size / RED_AT_PERCENT, 0, 1)
        # blue, green, red
        picture[met] *= 1 - wrong[:, None] * [0.85, 0.85, 0.0]
    return cv2.resize(picture, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA)


picture_path, folders = sys.argv[1], [pathlib.Path(argument) for argument in sys.argv[2:]]
columns = ["case", "centres, RMS", "mesh to truth: mean", "95 %", "truth to mesh: mean", "95 %", "found within 1 %"]
print("| " + " | ".join(columns) + " |")
print("|---|" + "---:|" * (len(columns) - 1))
tiles = []
for folder in folders:
    surface = o3d.io.read_triangle_mesh(str(folder / "surface.ply"))
    size = float(np.max(surface.get_max_bound() - surface.get_min_bound()))
    middle = surface.get_axis_aligned_bounding_box().get_center()
    truth = scene_of(surface)
    if not tiles:
        surface.compute_triangle_normals()
        tiles.append(rendered(surface, middle, size))
    mesh = o3d.io.read_triangle_mesh(str(folder / "mesh.ply"))
    tiles.append(rendered(mesh, middle, size, truth))
    percent = 100 / size
    wrong = percent * distance(truth, sampled(mesh)[0])
    points, normals = sampled(surface)
    cameras = model.truth(folder).views
    points = points[seen_by(truth, points, normals, [view.centre for view in cameras]) >= SEEN_BY]
    missing = percent * distance(scene_of(mesh), points)
    centres = percent * model.found(folder)[1]
    numbers = [centres, wrong.mean(), np.percentile(wrong, 95), missing.mean(), np.percentile(missing, 95)]
    row = [folder.name, *[f"{number:.3f}" for number in numbers], f"{100 * (missing <= 1).mean():.1f} %"]
    print("| " + " | ".join(row) + " |", flush=True)
print(f"\nsize of the object: {size:.2f} mm")
cv2.imwrite(picture_path, np.hstack(tiles).round().astype(np.uint8))

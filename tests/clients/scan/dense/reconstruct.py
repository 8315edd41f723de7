"""A mesh from the pictures, masks and COLMAP model of a case. See docs/POSES.md.

Usage: python3 reconstruct.py FOLDER...
Reads what `SCAN_FOLDER` left in each folder, writes `mesh.ply` there, in mm, in the coordinates of the true poses.
Needs the packages of requirements.txt, and COLMAP to read its model. Takes minutes per folder.
"""

import pathlib
import sys

import cv2
import depth
import model
import numpy as np
import open3d as o3d

# of the volume in which depth maps are averaged
VOXEL_MM, TRUNCATION_VOXELS = 0.08, 5.0
# a point of the surface is kept if more than this many depth maps have it
LEAST_VIEWS = 1.5
# what lies outside the silhouette of any view by more than this is removed, px
SILHOUETTE_PX = 3
# parts with less than this share of the triangles of the largest part are removed
LEAST_PART = 0.005


def fused(found, depths):
    """The surface in the mean of all depth maps (truncated signed distances, Curless and Levoy 1996)."""
    kind = o3d.core.float32
    volume = o3d.t.geometry.VoxelBlockGrid(("tsdf", "weight"), (kind, kind), ((1,), (1,)), VOXEL_MM, 16, 20_000)
    camera = o3d.core.Tensor(found.camera)
    # scale of the depths, largest depth, reach in voxels
    settings = (1.0, 1e4, TRUNCATION_VOXELS)
    for view, values in zip(found.views, depths):
        if not values.any():
            continue
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = view.rotation, view.translation
        pose = o3d.core.Tensor(pose)
        picture = o3d.t.geometry.Image(np.ascontiguousarray(values))
        blocks = volume.compute_unique_block_coordinates(picture, camera, pose, *settings)
        volume.integrate(blocks, picture, camera, pose, *settings)
    return volume.extract_triangle_mesh(LEAST_VIEWS).to_legacy()


def within_silhouettes(mesh, found, masks):
    """Removes what any view sees before its background, and small parts."""
    points = np.asarray(mesh.vertices)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * SILHOUETTE_PX + 1,) * 2)
    outside = np.zeros(len(points), bool)
    for view, mask in zip(found.views, masks):
        wide = cv2.dilate(mask, kernel)
        seen = (points @ view.rotation.T + view.translation) @ found.camera.T
        x, y = np.rint(seen[:, :2] / seen[:, 2:]).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < mask.shape[1]) & (y < mask.shape[0])
        outside |= inside & (wide[np.where(inside, y, 0), np.where(inside, x, 0)] == 0)
    mesh.remove_vertices_by_mask(outside)
    part, sizes, _ = mesh.cluster_connected_triangles()
    sizes = np.asarray(sizes)
    mesh.remove_triangles_by_mask(sizes[np.asarray(part)] < LEAST_PART * sizes.max())
    mesh.remove_unreferenced_vertices()
    return mesh


for argument in sys.argv[1:]:
    folder = pathlib.Path(argument)
    found, error_mm = model.found(folder)
    grey, masks = model.pictures(folder, found.views)
    depths = depth.depth_maps(found, grey, masks)
    mesh = within_silhouettes(fused(found, depths), found, masks)
    o3d.io.write_triangle_mesh(str(folder / "mesh.ply"), mesh)
    share = sum((values > 0).sum() for values in depths) / sum(mask.sum() for mask in masks)
    print(
        f"{folder.name}: {len(found.views)} views, centres of projection {error_mm:.3f} mm from the truth, depth for "
        f"{100 * share:.1f} % of the pixels, {len(mesh.triangles)} triangles",
        flush=True,
    )

"""Pictures of fields in their scene: voxels as cubes, open space as tinted air."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.patches import Patch
from numpy.typing import NDArray

from semmap.arrays import Floats
from semmap.draw.palette import INK, PAPER
from semmap.draw.rasteriser import Camera, nearest_triangles, quarters
from semmap.draw.shading import Surfaces, shade
from semmap.draw.sheet import rendered_sheet, save_sheet
from semmap.geometry.mesh import voxel_mesh


@dataclass(frozen=True, eq=False)
class FieldView:
    """A field in a picture, with its label in the legend."""

    voxels: NDArray[np.int32]  # (N, 3) indices
    voxel_size: float  # metres
    colour: str
    label: str
    opacity: float = 1.0  # 1 draws cubes, less draws transparent air


def voxel_faces(voxels: NDArray[np.int32], size: float) -> Floats:
    """Return the (F, 3, 3) triangles of those faces of cubes that no other cube covers, metres."""
    if not len(voxels):
        return np.zeros((0, 3, 3))
    return voxel_mesh(voxels.astype(np.int64)).triangles * size


def fields_picture(
    triangles: Floats,
    colours: Floats,
    fields: Sequence[FieldView],
    path: Path | str,
    *,
    title: str = "",
    azimuth: float = -60.0,
    elevation: float = 30.0,
    width: int = 1600,
) -> Path:
    """Draw fields in a scene and save the picture as PNG; return its path.

    The scene is triangles (F, 3, 3), metres, with colours (F, 3), sRGB in 0..1; azimuth and
    elevation from which it is seen are degrees, the width is pixels.
    """
    cubes = [f for f in fields if f.opacity >= 1]
    air = [f for f in fields if f.opacity < 1]
    solids = [triangles, *(voxel_faces(f.voxels, f.voxel_size) for f in cubes)]
    counts = [len(faces) for faces in solids]
    painted = [np.tile(to_rgb(f.colour), (n, 1)) for f, n in zip(cubes, counts[1:], strict=True)]
    count = sum(counts)
    surfaces = Surfaces(
        np.concatenate(solids),
        np.concatenate([colours, *painted]),
        np.repeat(np.arange(len(counts), dtype=np.int32), counts),
        np.full(count, np.inf),
        np.zeros(count, np.bool_),
    )
    shown = [surfaces.triangles.reshape(-1, 3), *((f.voxels + 0.5) * f.voxel_size for f in air)]
    camera = Camera.look(
        np.deg2rad(azimuth), np.deg2rad(elevation), np.concatenate(shown), 2 * width
    )
    paper = np.array(to_rgb(PAPER))
    picture, depth = shade(camera, surfaces, paper, paper, occlusion=0.3)
    for field in air:
        _, there = nearest_triangles(camera, voxel_faces(field.voxels, field.voxel_size))
        seen = there > depth
        picture[seen] += field.opacity * (np.array(to_rgb(field.colour)) - picture[seen])
    w, h = (n // 2 for n in camera.size)
    figure, axes = rendered_sheet(quarters(picture[: 2 * h, : 2 * w]).mean(axis=0), 150)
    legend = axes.legend(
        handles=[
            Patch(color=f.colour, alpha=min(1.0, f.opacity + 0.3), label=f.label)
            for f in fields
            if f.label
        ],
        loc="upper left",
        fontsize=9,
        facecolor=PAPER,
        labelcolor=INK,
        alignment="left",
        title=title or None,
        title_fontproperties={"weight": "bold", "size": 10},
    )
    assert legend is not None
    return save_sheet(figure, path)

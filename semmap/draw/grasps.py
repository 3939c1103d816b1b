"""Pictures of grasps on objects: each one a fork, whose colour tells its quality."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from semmap.draw.scene3d import scene3d
from semmap.draw.view import ObjectView, StoreyView
from semmap.geometry.mesh import Mesh, box_mesh, join

__all__ = ["fork", "grasps_picture"]

Floats = NDArray[np.float64]

THICKNESS = 0.0022
"""Of the lines of a fork, metres."""

ENLARGED = 12.0
"""Times that objects are drawn larger: scenes are lit for rooms."""


def fork(pose: Floats, width: float, depth: float = 0.04, stem: float = 0.03) -> Mesh:
    """Return a gripper as a fork: two fingers, the palm between them, and a stem.

    Parameters
    ----------
    pose : (4, 4) grasp frame: approach +z, closing +x, origin between the pads
    width : metres between the fingers
    depth, stem : lengths of fingers and stem, metres
    """
    half, t = width / 2 + THICKNESS, THICKNESS / 2
    bars = [
        box_mesh((-half - t, -t, -depth), (-half + t, t, 0.01)),
        box_mesh((half - t, -t, -depth), (half + t, t, 0.01)),
        box_mesh((-half - t, -t, -depth - t), (half + t, t, -depth + t)),
        box_mesh((-t, -t, -depth - stem), (t, t, -depth)),
    ]
    whole = join(bars)
    return Mesh(whole.vertices @ pose[:3, :3].T + pose[:3, 3], whole.faces)


def grasps_picture(
    objects: Sequence[tuple[str, Mesh]],
    grasps: Sequence[tuple[Floats, float, float]],
    path: Path | str,
    *,
    others: Sequence[tuple[Mesh, str]] = (),
    title: str = "",
    azimuth: float = -75.0,
    elevation: float = 22.0,
) -> Path:
    """Draw objects with grasps and return the path of the picture.

    Parameters
    ----------
    objects : names and meshes, in one frame, metres
    grasps : poses (4, 4) in that frame, widths in metres, and qualities in [0, 1]
    others : meshes with colours, such as a gripper or a table
    """
    views = [_view(name, mesh, "#d9c7a3") for name, mesh in objects]
    views += [_view("", mesh, colour) for mesh, colour in others]
    shades = colormaps["viridis"]
    low = min((q for _, _, q in grasps), default=0.0)
    for pose, width, quality in grasps:
        share = (quality - low) / max(1 - low, 1e-9)
        views.append(_view("", fork(pose, width), to_hex(shades(0.15 + 0.75 * share))))
    return scene3d(
        [StoreyView("grasps", objects=views)],
        path,
        title=title,
        boxes=False,
        cut=1e9,
        azimuth=azimuth,
        elevation=elevation,
        width=1500,
    )


def _view(name: str, mesh: Mesh, colour: str) -> ObjectView:
    return ObjectView(name, (), Mesh(mesh.vertices * ENLARGED, mesh.faces), colour=colour)

"""The posts of doorways: the faces in which walls end at both sides, exact where cells are not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString

from semmap.geometry.floor import section

LEVEL = 1.0
"""Metres above the floor at which posts are looked for: higher than sills, lower than lintels."""

ACROSS = (-0.04, -0.02, 0.0, 0.02, 0.04)
"""Metres across a doorway, in the wall, at which its posts are looked for."""

THICK = 0.6
"""Metres of the thickness of a wall, at most: a longer face is of a wall that passes by."""

FLAT = 0.002
"""Metres between the points of one face."""


def between_posts(
    lines: Sequence[LineString], triangles: NDArray[np.float64], floor: float, slack: float
) -> list[LineString]:
    """Return lines (in metres) of doorways, each moved to its posts, and amid the wall's thickness.

    `triangles` (N, 3, 3) are those of the walls. An end stays where no wall ends within `slack`
    metres of it.
    """
    faces = section(triangles, floor + LEVEL)[0]
    tree = shapely.STRtree(shapely.linestrings(faces))
    return [_between(line, faces, tree, slack) for line in lines]


def _between(
    line: LineString, faces: NDArray[np.float64], tree: shapely.STRtree, slack: float
) -> LineString:
    ends = shapely.get_coordinates(line)[[0, -1]]
    way = ends[1] - ends[0]
    length = float(np.hypot(*way))
    if length <= 2 * slack:
        return line
    axes = np.array([way, [-way[1], way[0]]]).T / length
    near = faces[tree.query(line, predicate="dwithin", distance=THICK)]
    local = (near - ends.mean(axis=0)) @ axes  # x along the line, y across it
    half = length / 2
    posts = [_post(local * (side, 1), half, slack) for side in (-1, 1)]
    at = [half if post is None else post for post, _ in posts]
    middles = [middle for _, middle in posts if middle is not None]
    aside = float(np.mean(middles)) if middles else 0.0
    moved = np.array([[-at[0], aside], [at[1], aside]]) @ axes.T + ends.mean(axis=0)
    return LineString(moved)


def _post(
    faces: NDArray[np.float64], half: float, slack: float
) -> tuple[float | None, float | None]:
    """Return the x of the post near `half`, and the y amid its face, of faces (N, 2, 2).

    The first is None without a post, the second where the wall does not end in a face across.
    """
    met = [x for y in ACROSS if (x := _first(faces, y, half, slack)) is not None]
    if 2 * len(met) <= len(ACROSS):
        return None, None
    x = min(met)
    flat = faces[(np.abs(faces[..., 0] - x) <= FLAT).all(axis=1), :, 1]
    if not len(flat) or np.ptp(flat) > THICK:
        return x, None
    return x, float(flat.min() + flat.max()) / 2


def _first(faces: NDArray[np.float64], y: float, half: float, slack: float) -> float | None:
    """The least x at which a line along x meets a face, within `slack` of `half`; None without."""
    (ax, ay), (bx, by) = faces[:, 0].T, faces[:, 1].T
    crosses = (ay > y) != (by > y)
    part = (y - ay[crosses]) / (by[crosses] - ay[crosses])
    x = ax[crosses] + part * (bx[crosses] - ax[crosses])
    near = x[np.abs(x - half) <= slack]
    return float(near.min()) if len(near) else None

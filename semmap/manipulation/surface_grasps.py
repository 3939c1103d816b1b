"""Grasps of any surface, a mesh or a part of a cloud: where two pads hold it, the best first.

Nguyen, "Constructing force-closure grasps", 1988: two pads hold by friction where the line between
them is within both friction cones. Pairs of points give such lines; both pads then close along
them on all points that are in their way, so that rims, handles, bars and edges of plates are held
as well as whole shapes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from semmap.arrays import Floats
from semmap.manipulation.candidates import (
    ANGLES,
    FRICTION,
    Grasps,
    grasp_candidates,
    grasp_names,
    quality_of,
)
from semmap.manipulation.collision import Obstacles, free_grasps
from semmap.manipulation.extra import is_installed
from semmap.manipulation.gripper import PAD, TILT, Gripper
from semmap.manipulation.solids import FITS, PrimitiveShape, solid_hull

if TYPE_CHECKING:
    import trimesh

SPACING = 0.002
"""Metres between points on a surface."""

MOST_POINTS = 60_000
"""Points on a surface; large ones have fewer to an area."""

SEEDS = 200
"""Points from which pairs are sought."""

LAYER = 0.002
"""Metres by which a pad gives way: points that deep are in contact."""

BUMP = 4e-4
"""Metres that pads and the noise of scans take off each side of the highest points."""

LATERAL = 0.5
"""The cosine between pad and surface below which the pad does not touch it: a wall beside it."""

CELLS = 5
"""The most cells of a pad along each of its sides, which are in contact or not."""

OF_HANDS = 16
"""Pairs at which all fingers of a hand are looked at, one by one."""

COARSE = 500
"""Points by which it is seen whether the palm touches a surface."""

PALM_ROOM = 0.01
"""Metres between palm and object beyond which more room makes a grasp no better."""

SHIFTS = ((0.005, 0, 0), (-0.005, 0, 0), (0.01, 0, 0), (-0.01, 0, 0))
"""Metres in the grasp frame by which a robot may be wrong, and should still touch nothing."""

KEPT = 200
"""The most grasps of a surface, beside those of its primitive."""

ALIKE = 0.01
"""Grasps nearer than this, and within some 20 degrees, count as one; metres."""


NOTHING = Obstacles(np.empty((0, 3, 3)))
"""What is around an object is not known yet."""


@dataclass(frozen=True, eq=False)
class SampledSurface:
    """Points (N, 3) on a surface with normals (N, 3) of either sign; `centre` (3,) of the mass."""

    points: Floats
    normals: Floats
    centre: Floats

    @cached_property
    def tree(self) -> cKDTree:
        """The points, to be sought by place."""
        return cKDTree(self.points)

    @cached_property
    def cells(self) -> int:
        """Cells along a side of a pad, of which each has points where the surface is: 1 to 5."""
        some = self.points[:: max(1, len(self.points) // COARSE)]
        near = self.tree.query(some, min(2, len(self.points)))[0].reshape(len(some), -1)[:, -1]
        apart = 2 * float(np.median(near))  # of points at random, the nearest is half as far
        return int(np.clip(PAD / max(1.4 * apart, 1e-6), 1, CELLS))

    @cached_property
    def radius(self) -> float:
        """Half the diagonal of the box of the points, metres."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)) / 2)


def surface_of(mesh: trimesh.Trimesh, centre: Floats) -> SampledSurface:
    """Points at random on a mesh, the same in each run."""
    import trimesh

    count = int(np.clip(mesh.area / SPACING**2, 500, MOST_POINTS))
    points, faces = trimesh.sample.sample_surface(mesh, count, seed=0)
    return SampledSurface(np.asarray(points), np.asarray(mesh.face_normals)[faces], centre)


def mesh_grasps(
    mesh: trimesh.Trimesh, shape: PrimitiveShape, gripper: Gripper, **options: float
) -> Grasps:
    """Grasps of a mesh, whose primitive is `shape`; both in the frame of the model.

    Those of the primitive (`grasp_candidates`), judged by the mesh unless that is the primitive or
    the gripper a hand, and those of the mesh itself (`surface_grasps`). Without the library for
    collisions, only the first. `options` are those of `grasp_candidates`.
    """
    of_shape = grasp_candidates(shape, gripper, **options)
    if (shape.inliers >= FITS and len(of_shape)) or not is_installed("fcl"):
        return of_shape  # nothing tells what the fingers touch
    centre = solid_hull(np.asarray(mesh.vertices)[np.unique(mesh.faces)])[1]
    surface = surface_of(mesh, centre)
    if len(gripper.spread) == 1:  # the fingers of a hand give way to the shape
        judged = held_by(surface, of_shape, options.get("friction", FRICTION))
        of_shape = _free(judged, Obstacles(mesh.triangles))
    of_mesh = surface_grasps(surface, gripper, mesh.triangles, frame=shape.pose, **options)
    return Grasps.joined([of_shape, of_mesh])


def surface_grasps(
    surface: SampledSurface,
    gripper: Gripper,
    triangles: Floats,
    *,
    frame: Floats | None = None,
    friction: float = FRICTION,
    distance: float = 0.1,
) -> Grasps:
    """The best `KEPT` grasps of a surface, from all sides, without touching `triangles` before.

    Parameters
    ----------
    surface : in the frame of the model
    triangles : (F, 3, 3) of the object, which the open fingers must not touch
    frame : (4, 4) of the object's shape in that of the model; approaches are named by its axes
    friction : coefficient between pads and object
    distance : metres between pre-grasp and grasp

    Notes
    -----
    The quality is that of `grasp_candidates`, by points: the friction angle that the worse pad's
    mean normal leaves; the share of the pads' cells with a point within `LAYER` of the first
    contact; the nearness of the closing axis to the centre of mass; the gap beside the fingers. It
    is less where little room is left before the palm, or where a shift lets fingers touch.
    """
    frame = np.eye(4) if frame is None else frame
    middles, axes, shifts = _moved(*_pairs(surface, gripper.opening, friction))
    if len(gripper.spread) > 1:  # the fingers of a hand matter at each approach: fewer pairs
        best = _best_pairs(surface, gripper, middles, axes, friction)
        middles, axes, shifts = middles[best], axes[best], shifts[best]
    turned = [_approaches(axis, gripper) for axis in axes]
    pair = np.repeat(np.arange(len(turned)), [len(each[0]) for each in turned])
    x, z = (np.concatenate([np.empty((0, 3)), *(each[i] for each in turned)]) for i in (0, 1))
    rotations, targets = np.stack([x, np.cross(z, x), z], axis=2), middles[pair]
    if len(gripper.spread) == 1:  # pads are discs: the approach does not matter to them
        of_pair, first = np.unique(pair, return_index=True)
        held = _contacts(surface, gripper, rotations[first], targets[first], friction)
        held = held[np.searchsorted(of_pair, pair)]
        # the pads change sides where the closing axis turns round
        held[:, 0] *= np.sign(np.einsum("ni,ni->n", x, x[first][np.searchsorted(of_pair, pair)]))
    else:
        held = _contacts(surface, gripper, rotations, targets, friction)
    by_ends = np.einsum("ni,ni->n", shifts[pair], z)[held[:, 2] > 0] < -PAD / 6
    made = _placed(surface, gripper, rotations, targets, held)
    order = np.argsort(-made[2], kind="stable")
    order = order[made[2][order] > 0]
    rotations, targets, quality, width = (column[order] for column in made)
    chosen = from_all_sides(rotations, targets, by_ends[order], gripper.is_symmetric)
    poses = _poses(gripper, rotations[chosen], targets[chosen], width[chosen])
    before = poses.copy()
    before[:, :3, 3] -= distance * poses[:, :3, 2]
    none = np.zeros(len(chosen), np.intp)
    kind = np.full(len(chosen), "part")
    names, families = grasp_names(frame[:3, :3].T @ poses[:, :3, :3], none, kind, "xyz")
    found = Grasps(gripper, poses, before, width[chosen], quality[chosen], names, families)
    return _free(found, Obstacles(triangles), KEPT)


def held_by(surface: SampledSurface, grasps: Grasps, friction: float = FRICTION) -> Grasps:
    """Grasps by what their pads meet on a surface; those that hold nothing there are left out."""
    gripper, rotations = grasps.gripper, grasps.poses[:, :3, :3]
    pads = np.einsum("nij,nj->ni", rotations, gripper.pads_at(grasps.widths))
    targets = grasps.poses[:, :3, 3] + pads
    held = _contacts(surface, gripper, rotations, targets, friction)
    kept = np.flatnonzero(held[:, 2] > 0)
    rotations, targets, quality, width = _placed(surface, gripper, rotations, targets, held)
    poses = _poses(gripper, rotations, targets, width)
    moved = (poses - grasps.poses[kept])[:, :3, 3]
    before = grasps.pre_grasps[kept].copy()
    before[:, :3, 3] += moved
    found = replace(grasps[kept], poses=poses, pre_grasps=before, widths=width, qualities=quality)
    return found[np.flatnonzero(quality > 0)]


def _placed(
    surface: SampledSurface, gripper: Gripper, rotations: Floats, targets: Floats, held: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Rotations, targets, qualities and widths of those that hold something."""
    kept = np.flatnonzero(held[:, 2] > 0)
    rotations, (shift, width, quality) = rotations[kept], held[kept].T
    targets = targets[kept] + shift[:, None] * rotations[:, :, 0]
    quality = quality * _room_before_palm(surface, gripper, rotations, targets)
    return rotations, targets, quality, width


def _poses(gripper: Gripper, rotations: Floats, targets: Floats, width: Floats) -> Floats:
    """Grasp frames (N, 4, 4) whose pads are around targets when they have closed."""
    poses = np.tile(np.eye(4), (len(width), 1, 1))
    poses[:, :3, :3] = rotations
    poses[:, :3, 3] = targets - np.einsum("nij,nj->ni", rotations, gripper.pads_at(width))
    return poses


def _pairs(surface: SampledSurface, opening: float, friction: float) -> tuple[Floats, Floats]:
    """Middles (N, 3) and axes (N, 3) of lines within both friction cones, by random points."""
    random = np.random.default_rng(0)
    points, normals = surface.points, surface.normals
    chosen = random.choice(len(points), min(SEEDS, len(points)), replace=False)
    cone = np.cos(np.arctan(friction))
    middles, axes = [np.empty((0, 3))], [np.empty((0, 3))]
    for i in chosen:
        others = np.array(surface.tree.query_ball_point(points[i], opening))
        line = points[others] - points[i]
        apart = np.linalg.norm(line, axis=1)
        seen = np.abs(line @ normals[i]) > 0.999 * cone * apart  # most are not, and cost time below
        far = np.flatnonzero(seen & (apart > SPACING / 2))
        others, line, apart = others[far], line[far] / apart[far, None], apart[far]
        facing = np.abs(line @ normals[i])
        held = (facing > cone) & (np.abs(np.einsum("ni,ni->n", line, normals[others])) > cone)
        held &= apart * np.sqrt(1 - np.minimum(facing, 1) ** 2) < ALIKE  # along the normal
        if not held.any():
            continue
        opposite = np.einsum("ni,ni->n", line, normals[others])
        straight = facing * np.abs(opposite)
        axis = np.sign(line @ normals[i])[:, None] * normals[i]
        axis = axis + np.sign(opposite)[:, None] * normals[others]  # pads lie flat on both sides
        walls = np.round(apart / ALIKE).astype(int)
        for wall in np.unique(walls[held]):
            best = np.argmax(np.where(held & (walls == wall), straight, 0))
            middles.append(points[None, i] + line[None, best] * apart[best] / 2)
            axes.append(axis[None, best] / np.linalg.norm(axis[best]))
    return np.concatenate(middles), np.concatenate(axes)


def _moved(middles: Floats, axes: Floats) -> tuple[Floats, Floats, Floats]:
    """Pairs, and each again beside its axis, by how much (N, 3): ends of pads hold a low rim."""
    aside = np.array([np.linalg.svd(axis[None])[2][1:] for axis in axes]).reshape(-1, 2, 3)
    ways = (
        np.zeros_like(axes),
        *(way * aside[:, i] for i in (0, 1) for way in (PAD / 3, -PAD / 3)),
    )
    shifts = np.concatenate(ways)
    return np.tile(middles, (len(ways), 1)) + shifts, np.tile(axes, (len(ways), 1)), shifts


def _best_pairs(
    surface: SampledSurface, gripper: Gripper, middles: Floats, axes: Floats, friction: float
) -> NDArray[np.intp]:
    """The numbers of the pairs that two pads alone would hold best."""
    two = replace(gripper, spread=np.zeros(1))
    aside = [np.linalg.svd(axis[None])[2][1] for axis in axes]
    rotations = np.array(
        [np.column_stack([x, np.cross(z, x), z]) for x, z in zip(axes, aside, strict=True)]
    ).reshape(-1, 3, 3)
    quality = _contacts(surface, two, rotations, middles, friction)[:, 2]
    best = np.argsort(-quality, kind="stable")[:OF_HANDS]
    return best[quality[best] > 0]


def _approaches(axis: Floats, gripper: Gripper) -> tuple[Floats, Floats]:
    """Closing axes and approaches (N, 3), all around an axis of a pair.

    A gripper that its arm cannot tilt comes at its slant, to an object that stands as its model or
    upside down.
    """
    if gripper.up is None:
        x, z = _around(axis)
    else:
        x, z = (np.concatenate(each) for each in zip(*_slanted(axis, gripper.up), strict=True))
        return x, z
    if gripper.is_symmetric:
        return x, z
    return np.concatenate([x, -x]), np.concatenate([z, z])


def _around(axis: Floats) -> tuple[Floats, Floats]:
    """A closing axis, and approaches (N, 3) at all angles about it."""
    side = np.linalg.svd(axis[None])[2][1]
    other = np.cross(axis, side)
    angle = np.linspace(0, 2 * np.pi, 2 * (ANGLES - 1), endpoint=False)
    return np.tile(axis, (len(angle), 1)), np.outer(np.cos(angle), side) + np.outer(
        np.sin(angle), other
    )


def _slanted(axis: Floats, tilt: Floats) -> list[tuple[Floats, Floats]]:
    """The same where `tilt` (3,) is the vertical in the grasp frame: level closing axes."""
    found = [(np.empty((0, 3)), np.empty((0, 3)))]
    for up in ((0.0, 0, 1), (0.0, 0, -1)):
        vertical = np.array(up)
        level = axis - (axis @ vertical - tilt[0]) * vertical
        length = float(np.linalg.norm(level))
        if length < LATERAL:  # the pair is one above the other
            continue
        x = level / length
        side = np.cross(vertical, x)
        for sign in (1, -1):
            for way in (1, -1):
                z = tilt[2] * vertical + way * np.sqrt(max(0.0, 1 - tilt[2] ** 2)) * side
                made = np.array(
                    [sign * x @ vertical, np.cross(z, sign * x) @ vertical, z @ vertical]
                )
                if np.abs(made - tilt).max() < TILT:
                    found.append(((sign * x)[None], z[None]))
    return found


def _contacts(
    surface: SampledSurface, gripper: Gripper, rotations: Floats, targets: Floats, friction: float
) -> Floats:
    """(N, 3): metres by which targets are moved along x, widths and qualities, 0 for none."""
    found = np.zeros((len(targets), 3))
    half, fine = gripper.opening / 2, surface.cells
    pads = [(-1, 0.0), *((1, float(y)) for y in gripper.spread)]
    beside = max(abs(y) for _, y in pads) + PAD / 2
    reach, room = np.hypot(half, beside), np.array((half, beside, PAD / 2))
    shares, held = np.zeros((len(targets), 3)), np.zeros(len(targets), bool)
    last = np.full(3, np.nan)
    points = normals = np.empty((0, 3))
    for i, (rotation, target) in enumerate(zip(rotations, targets, strict=True)):
        if (target != last).any():  # the same for all approaches to a pair
            some = np.array(surface.tree.query_ball_point(target, reach), np.intp)
            last, points, normals = target, surface.points[some] - target, surface.normals[some]
        at = points @ rotation
        between = np.flatnonzero((np.abs(at) <= room).all(axis=1))
        at, facing = at[between], np.abs(normals[between] @ rotation[:, 0])
        ends, angles, covers = {-1: [], 1: []}, [], []  # type: dict[int, list[float]], list[float], list[float]
        for side, y in pads:
            met = np.hypot(at[:, 1] - y, at[:, 2]) <= PAD / 2
            if not met.any():
                covers.append(0.0)
                continue
            end = float((side * at[met, 0]).max())
            depth = end - side * at[:, 0]
            layer = met & (depth < LAYER) & (facing > LATERAL)
            ends[side].append(end)
            pressed = facing[layer] * (1 - depth[layer] / LAYER)  # by the area that the pad sees
            total = pressed.sum()
            angles.append(float(np.arccos(min(1, pressed @ facing[layer] / total))) if total else 9)
            cells = np.floor((at[layer, 1:] - [y, 0]) / PAD * fine + fine / 2).astype(int)
            seen = np.bincount(cells[:, 0] * 2 * (fine + 1) + cells[:, 1])
            covers.append(np.count_nonzero(seen) / max(1, np.pi / 4 * fine**2))
        if not (ends[-1] and ends[1]):
            continue
        left, right = max(ends[-1]), max(ends[1])
        width, shift = left + right - 2 * BUMP, (right - left) / 2
        middle = target + shift * rotation[:, 0]
        lever = surface.centre - middle
        lever = lever - (lever @ rotation[:, 0]) * rotation[:, 0]
        shares[i] = (
            1 - max(angles) / np.arctan(friction),
            min(1.0, float(np.mean(covers))),
            1 - float(np.linalg.norm(lever)) / surface.radius,
        )
        found[i, :2] = shift, width
        held[i] = True
    left, on_object, centring = shares[held].T
    found[held, 2] = quality_of(gripper, left, on_object, centring, found[held, 1])
    return found


def _room_before_palm(
    surface: SampledSurface, gripper: Gripper, rotations: Floats, targets: Floats
) -> Floats:
    """(N,) by the share of `PALM_ROOM` that is left between the palm and what fingers close on."""
    every = max(1, len(surface.points) // COARSE)
    points = surface.points[::every]
    share = np.zeros(len(targets))
    for start in range(0, len(targets), AT_ONCE):
        some = slice(start, start + AT_ONCE)
        at = points @ rotations[some] - targets[some, None] @ rotations[some]
        between = (np.abs(at[:, :, 0]) < gripper.opening / 2) & (np.abs(at[:, :, 1]) < PAD)
        back = np.where(between, -at[:, :, 2], 0).max(axis=1)
        share[some] = np.clip((gripper.depth - back) / PALM_ROOM, 0, 1) ** 0.25
    return share


def from_all_sides(
    rotations: Floats, targets: Floats, by_ends: NDArray[np.bool_], is_symmetric: bool
) -> NDArray[np.intp]:
    """Grasps that are not much alike: first the best of each direction, then the next of each.

    Those `by_ends` (N,) of the pads are a direction of their own.
    """
    closing, approach = rotations[:, :, 0], rotations[:, :, 2]
    either = closing  # half a turn of a symmetric gripper is the same grasp
    if is_symmetric:
        either = np.einsum("ni,nj->nij", closing, closing).reshape(-1, 9)
    key = np.concatenate([targets / ALIKE, either * 3, approach * 3], axis=1).round()
    unlike = np.sort(np.unique(key, axis=0, return_index=True)[1])
    columns = np.abs(closing), approach, by_ends[:, None]
    side = np.concatenate(columns, axis=1)[unlike].round()
    group = np.unique(side, axis=0, return_inverse=True)[1].ravel()
    by_group = np.argsort(group, kind="stable")
    starts = np.searchsorted(group[by_group], group)
    place = np.empty(len(unlike), np.intp)
    place[by_group] = np.arange(len(unlike))
    turn = place - starts
    return unlike[np.argsort(turn, kind="stable")]


def _free(grasps: Grasps, item: Obstacles, most: int | None = None) -> Grasps:
    """The first grasps that are free of the object, with less quality for little room."""
    found = grasps[first_free(grasps, item, len(grasps) if most is None else most)]
    found = replace(found, qualities=found.qualities * _room(found, item))
    return found[np.argsort(-found.qualities, kind="stable")]


def _room(grasps: Grasps, item: Obstacles) -> Floats:
    """(N,) a share of 1/5 to 1: how many of `SHIFTS` leave the open gripper free of the object."""
    free = np.zeros(len(grasps))
    for shift in SHIFTS:
        move = np.einsum("nij,j->ni", grasps.poses[:, :3, :3], np.array(shift))
        moved = replace(grasps, poses=grasps.poses.copy(), pre_grasps=grasps.pre_grasps.copy())
        moved.poses[:, :3, 3] += move
        moved.pre_grasps[:, :3, 3] += move
        free += free_grasps(moved, np.eye(4), NOTHING, item=item)
    share: Floats = (1 + free) / (1 + len(SHIFTS))
    return share


def first_free(grasps: Grasps, item: Obstacles, most: int) -> NDArray[np.intp]:
    """The first grasps whose open gripper does not touch the object on its way."""
    found: list[int] = []
    for start in range(0, len(grasps), AT_ONCE):
        some = np.arange(start, min(start + AT_ONCE, len(grasps)))
        free = free_grasps(grasps[some], np.eye(4), NOTHING, item=item)
        found += some[free].tolist()
        if len(found) >= most:
            break
    return np.array(found[:most], np.intp)


AT_ONCE = 64
"""Grasps that are checked at a time, until enough of them are free."""

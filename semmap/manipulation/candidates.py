"""Grasps of a shape by a gripper, the best first (Tosello et al., section IV-B, Action Generator).

The fingers close along an axis of the shape, through its centre of mass or beside it, and the
gripper comes from all angles around that axis, 17 in each half turn. For each angle there are two
approaches: along the gripper's own axis, and straight along the nearest axis of the shape. A
gripper that its arm cannot tilt keeps its slant, and is also lowered from above.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from semmap.arrays import Floats
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper import PAD, TILT, Gripper
from semmap.manipulation.solids import ConvexSolid, PrimitiveShape, solid_of

ANGLES = 17
"""Angles of a pass, half a turn with both ends."""

CLEARANCE = 0.004
"""Least sum of the gaps between object and open fingers, metres."""

ROOM = 0.02
"""Sum of the gaps beyond which more room makes a grasp no better, metres."""

FRICTION = 0.5
"""The coefficient between pads and objects that is assumed."""

X, Y, Z = np.eye(3)


class Pass(NamedTuple):
    """Grasps that close along one axis; the approach turns about `about` from `first`."""

    closing: Floats | None
    """Fixed, or None where the closing axis is `about` x approach and turns with it."""

    about: Floats
    first: Floats
    twist: bool = False
    """The approach stays `first`, and the closing axis turns about it."""


_AXES = (Pass(X, X, Y), Pass(Y, Y, X), Pass(Z, Z, X))
_ROUND = (*_AXES, Pass(None, Z, X), Pass(None, -Z, -Z, True), Pass(None, Z, Z, True))

PASSES: dict[str, tuple[Pass, ...]] = {
    "cuboid": _AXES,
    "cylinder": _ROUND,
    "cone": _ROUND,
    "sphere": _ROUND,
}
"""The passes over each kind of shape: its axes; around, from above and from below where round."""


@dataclass(frozen=True, eq=False)
class Grasp:
    """A grasp of a model by a gripper; metres.

    `pose` and `pre_grasp` (4, 4) are the grasp frame in the model's frame, `width` is between the
    pads, None for a suction cup; `approach` is "top", "above", "side", "below" or "bottom" by the z
    axis of the shape. `family` is what it has in common with grasps of similar shapes: approach;
    closing axis x, y or z, or r across a round shape; degrees above the side; offset; kind of
    approach. `shift` (3,) moved it from the candidate, in its own frame.
    """

    pose: Floats
    pre_grasp: Floats
    width: float | None
    approach: str
    family: str
    quality: float
    posture: dict[str, float]
    pre_posture: dict[str, float]
    shift: Floats | None = None


@dataclass(frozen=True, eq=False)
class Grasps:
    """Grasps of a model by a gripper: poses (N, 4, 4), others (N,); `grasps[i]` is a `Grasp`."""

    gripper: Gripper
    poses: Floats
    pre_grasps: Floats
    widths: Floats
    qualities: Floats
    approaches: NDArray[np.str_]
    families: NDArray[np.str_]

    @classmethod
    def of_rows(
        cls, gripper: Gripper, rows: Sequence[Mapping[str, Any]], poses: Floats, before: Floats
    ) -> Grasps:
        """Stored actions, rows of `actions_on`, whose poses (N, 4, 4) are in a frame of choice."""
        return cls(
            gripper,
            poses,
            before,
            np.array([gripper.opening if row["width"] is None else row["width"] for row in rows]),
            np.array([row["expected"] for row in rows]),
            np.array([row["approach"] or "" for row in rows]),
            np.array([row["family"] or "" for row in rows]),
        )

    @classmethod
    def joined(cls, every: Sequence[Grasps]) -> Grasps:
        """The grasps of several by one gripper, the best first."""
        columns = [each.name for each in fields(cls) if each.name != "gripper"]
        whole = cls(
            every[0].gripper,
            *(np.concatenate([getattr(one, name) for one in every]) for name in columns),
        )
        return whole[np.argsort(-whole.qualities, kind="stable")]

    def __len__(self) -> int:
        return len(self.poses)

    def __iter__(self) -> Iterator[Grasp]:
        return (self[i] for i in range(len(self)))

    @overload
    def __getitem__(self, chosen: int) -> Grasp: ...

    @overload
    def __getitem__(self, chosen: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Grasps: ...

    def __getitem__(
        self, chosen: int | NDArray[np.intp] | NDArray[np.bool_] | slice
    ) -> Grasp | Grasps:
        """One grasp, or those that an index array, a mask or a slice chooses."""
        if isinstance(chosen, int | np.integer):
            width = float(self.widths[chosen])
            return Grasp(
                self.poses[chosen],
                self.pre_grasps[chosen],
                None if self.gripper.cup is not None else width,
                str(self.approaches[chosen]),
                str(self.families[chosen]),
                float(self.qualities[chosen]),
                self.gripper.posture(width),
                dict(self.gripper.postures[0]),
            )
        columns = [each.name for each in fields(self) if each.name != "gripper"]
        return replace(self, **{name: getattr(self, name)[chosen] for name in columns})


def grasp_candidates(
    shape: PrimitiveShape, gripper: Gripper, *, friction: float = FRICTION, distance: float = 0.1
) -> Grasps:
    """Return all grasps of a shape that fit the gripper and hold by friction, the best first.

    No two of them are equal, half a turn of a symmetric gripper included. There are none if the
    object is too wide or too thin for the gripper.

    Parameters
    ----------
    shape : in the frame of the model
    friction : coefficient between pads and object
    distance : metres between pre-grasp and grasp

    Notes
    -----
    The quality is the geometric mean of four shares: the friction angle that the worst contact
    leaves; the part of the pads that lies on the object; the nearness of the closing axis to the
    centre of mass, by the shape's radius; the gap between object and fingers, up to 1 cm a side.

    Raises
    ------
    ManipulationError
        The shape has no volume, a number is not above 0, or the gripper is a suction cup.
    """
    if gripper.cup is not None:
        raise ManipulationError(
            f"{gripper.name} is a suction cup, which closes on nothing: take shape_grasps"
        )
    if not (friction > 0 and distance > 0):
        raise ManipulationError(
            f"friction is {friction:g} and distance {distance:g}: give numbers above 0"
        )
    solid = solid_of(shape.kind, shape.size)
    rotations, targets, offsets = _frames(solid, gripper)
    held = _contacts(solid, gripper, rotations, targets, friction)
    keep = held.quality > 0
    rotations, offsets = rotations[keep], offsets[keep]
    targets, width, quality = held.target[keep], held.width[keep], held.quality[keep]
    approach = rotations[:, :, 2]
    poses = np.tile(np.eye(4), (len(width), 1, 1))
    poses[:, :3, :3] = rotations
    poses[:, :3, 3] = targets - np.einsum("nij,nj->ni", rotations, gripper.pads_at(width))
    straight = np.zeros_like(approach)
    axis = np.argmax(np.abs(approach).round(9), axis=1)
    rows = np.arange(len(axis))
    straight[rows, axis] = np.sign(approach[rows, axis])
    ways = {"own": approach, "straight": straight}
    if gripper.up is not None:
        ways["lowered"] = -rotations @ gripper.up
    times = len(ways)
    poses = np.tile(poses, (times, 1, 1))
    before = poses.copy()
    before[:, :3, 3] -= distance * np.concatenate([*ways.values()])
    kinds = np.repeat([*ways], len(width))
    letters = "xyz" if solid.kind == "cuboid" else "rrz"  # round: across is across
    names, families = grasp_names(
        np.tile(rotations, (times, 1, 1)), np.tile(offsets, times), kinds, letters
    )
    order = np.argsort(-np.tile(quality, times), kind="stable")
    found = Grasps(
        gripper,
        shape.pose @ poses[order],
        shape.pose @ before[order],
        np.tile(width, times)[order],
        np.tile(quality, times)[order],
        names[order],
        families[order],
    )
    return _without_duplicates(found)


def _without_duplicates(grasps: Grasps) -> Grasps:
    """Grasps without those that equal an earlier one, half a turn of the gripper included.

    Two are equal if their poses and their approaches are, within 1e-6 m and rad.
    """
    if len(grasps) < 2:
        return grasps
    rotations, position = grasps.poses[:, :3, :3], grasps.poses[:, :3, 3]
    closing = rotations[:, :, 0]
    if grasps.gripper.is_symmetric:
        closing = np.einsum("ni,nj->nij", closing, closing).reshape(-1, 9)
    before = grasps.pre_grasps[:, :3, 3]
    compared = np.concatenate([position, before, rotations[:, :, 2], closing], axis=1)
    pairs = cKDTree(compared).query_pairs(1e-6, output_type="ndarray")
    keep = np.ones(len(grasps), bool)
    keep[pairs.max(axis=1)] = False
    return grasps[keep]


def _frames(solid: ConvexSolid, gripper: Gripper) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Rotations (N, 3, 3), targets (N, 3) of the pads, and offsets (N,) along y: -1, 0 or 1."""
    closing, approach = [], []
    every: Floats = np.linspace(0, 2 * np.pi, 2 * (ANGLES - 1), endpoint=False)
    slants = _slants(gripper)
    slanted = every
    if slants:
        slanted = np.add.outer(np.array(slants), np.pi / 2 * np.arange(4)).ravel()
    for one in PASSES[solid.kind]:
        if one.twist and slants and min(abs(np.sin(2 * np.array(slants)))) > TILT:
            continue
        angle = every if one.twist else slanted
        turned = _turned(one, angle)
        if one.twist:
            side = np.cross(one.first, X if abs(one.first[0]) < 0.9 else Y)
            other = np.cross(one.first, side)
            closing.append(np.outer(np.cos(angle), side) + np.outer(np.sin(angle), other))
            approach.append(np.tile(one.first, (len(angle), 1)))
        elif one.closing is None:
            closing.append(np.cross(one.about, turned))
            approach.append(turned)
            turned = _turned(one, every[::2])
            for slant in slants:  # it stands
                closing.append(np.cross(one.about, turned))
                approach.append(np.cos(slant) * turned + np.sin(slant) * one.about)
        else:
            closing.append(np.tile(one.closing, (len(angle), 1)))
            approach.append(turned)
    x, z = np.concatenate(closing), np.concatenate(approach)
    if gripper.is_symmetric is False:  # the other way round is another grasp
        x, z = np.concatenate([x, -x]), np.concatenate([z, z])
    rotations = np.stack([x, np.cross(z, x), z], axis=2)
    centre = np.tile(solid.centre, (len(x), 1))
    y = rotations[:, :, 1]
    left, right = solid.exits(centre, -y)[0], solid.exits(centre, y)[0]
    shift = np.stack([-left / 2, np.zeros(len(x)), right / 2], axis=1)
    wanted = np.abs(shift) > PAD
    wanted[:, 1] = True
    row, column = np.nonzero(wanted)
    rotations = rotations[row]
    targets = centre[row] + shift[row, column][:, None] * y[row]
    # The object must fit between pads and palm: thick ones are held nearer to the gripper.
    near = solid.exits(targets, -rotations[:, :, 2])[0]
    excess = np.maximum(near - max(gripper.depth - 0.005, PAD / 2), 0)
    return rotations, targets - excess[:, None] * rotations[:, :, 2], column - 1


def _slants(gripper: Gripper) -> list[float]:
    """The slants, radians, of a gripper that its arm cannot tilt, for each end of a shape above.

    Of an object that stands or lies on an axis of its shape, it gets to no other.
    """
    if gripper.up is None:
        return []
    slant = float(np.arcsin(np.clip(gripper.up[2], -1, 1)))
    return [slant, -slant]


def _turned(one: Pass, angle: Floats) -> Floats:
    """(N, 3) the first approach of a pass, turned about its axis."""
    turned: Floats = np.outer(np.cos(angle), one.first) + np.outer(
        np.sin(angle), np.cross(one.about, one.first)
    )
    return turned


class _Contacts(NamedTuple):
    """Targets (N, 3) in the middle between the contacts, widths and qualities (N,), 0 for none."""

    target: Floats
    width: Floats
    quality: Floats


def _contacts(
    solid: ConvexSolid, gripper: Gripper, rotations: Floats, targets: Floats, friction: float
) -> _Contacts:
    x, y, z = np.moveaxis(rotations, 2, 0)
    count, fingers = len(targets), len(gripper.spread)
    thumb, thumb_normal = solid.exits(targets, -x)
    starts = (targets[:, None] + gripper.spread[:, None] * y[:, None]).reshape(-1, 3)
    inside = solid.contains(starts)
    reached, normals = solid.exits(starts, np.repeat(x, fingers, axis=0))
    reached = np.where(inside, reached, 0).reshape(count, fingers)
    inside = inside.reshape(count, fingers)
    facing = np.einsum("nfi,ni->nf", normals.reshape(count, fingers, 3), x)
    facing = np.where(inside, facing, 1.0)
    worst = np.minimum(facing.min(axis=1), -np.einsum("ni,ni->n", thumb_normal, x))
    across = reached.max(axis=1)
    width = thumb + across
    centred = targets + ((across - thumb) / 2)[:, None] * x
    angle = np.arccos(np.clip(worst, -1, 1))
    friction_left = 1 - angle / np.arctan(friction)
    grid = np.linspace(-0.4, 0.4, 5) * PAD
    dy, dz = (v.reshape(-1) for v in np.meshgrid(grid, grid))
    pad = centred[:, None] + dy[:, None] * y[:, None] + dz[:, None] * z[:, None]
    on_object = solid.contains(pad).mean(axis=1) * inside.mean(axis=1)
    lever = solid.centre - centred
    lever -= np.einsum("ni,ni->n", lever, x)[:, None] * x
    radius = np.linalg.norm(np.ptp(solid.mesh(16).used, axis=0)) / 2
    centring = 1 - np.linalg.norm(lever, axis=1) / radius
    held = inside.any(axis=1)
    quality = np.where(held, quality_of(gripper, friction_left, on_object, centring, width), 0.0)
    return _Contacts(centred, width, quality)


def quality_of(
    gripper: Gripper, friction_left: Floats, on_object: Floats, centring: Floats, width: Floats
) -> Floats:
    """The geometric mean of three shares and of the room beside the object; 0 for no fit."""
    gap = gripper.opening - width
    fits = (gap >= CLEARANCE) & (width > gripper.widths[-1] + 1e-3)
    shares = np.clip(np.stack([friction_left, on_object, centring, gap / ROOM]), 0, 1)
    quality: Floats = np.where(fits, np.prod(shares, axis=0) ** 0.25, 0.0)
    return quality


def grasp_names(
    rotations: Floats, offsets: NDArray[np.intp], kinds: NDArray[np.str_], letters: str
) -> tuple[NDArray[np.str_], NDArray[np.str_]]:
    """The approach and the family of each grasp."""
    step = np.pi / (ANGLES - 1)
    elevation = np.round(np.arcsin(np.clip(-rotations[:, 2, 2], -1, 1)) / step).astype(int)
    half = (ANGLES - 1) // 2
    approach = np.select(
        [elevation == half, elevation > 0, elevation == 0, elevation > -half],
        ["top", "above", "side", "below"],
        "bottom",
    )
    axis = np.argmax(np.abs(rotations[:, :, 0]).round(6), axis=1)
    family = [
        f"{a} {letters[c]} {round(float(np.degrees(step * e)))} {'-0+'[o + 1]} {k}"
        for a, c, e, o, k in zip(approach, axis, elevation, offsets, kinds, strict=True)
    ]
    return approach, np.array(family, np.str_)

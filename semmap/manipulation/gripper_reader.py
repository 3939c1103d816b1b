"""Grippers of robots, as the URDF of a gripper or of a whole robot describes them.

A palm is a link on which at least two fingers move: short chains without a branch. Where a robot
has none, a link that is one jaw itself and on which the other one moves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from semmap.arrays import Floats
from semmap.geometry.mesh import Mesh, join
from semmap.geometry.outline import hull_points
from semmap.manipulation.cup_reader import cup_links, read_cup
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper import PAD, Gripper, transformed
from semmap.manipulation.link_tree import LinkTree, fixed_vertical
from semmap.manipulation.suction import Cup
from semmap.robot.urdf import Joint, Robot, load_robot
from semmap.suggestions import suggestion

FINGER = 0.35
"""The greatest length of a finger, metres; longer chains are arms and legs."""

TOUCH = 1e-3
"""Metres between pads that touch."""

STEPS = 33
"""Postures between open and closed that are computed in advance."""

SAMPLES = 1500
"""Points on the surface of a link from which the width between fingers is measured."""


WIDEST = 0.4
"""Metres between fingers beyond which they are arms."""

SLICE = 0.01
"""Metres between slices of a link with a jaw, each of which is taken for convex."""

WEDGE = 0.8
"""Radians to which a jaw opens: two pads that friction of 0.5 holds on are within 0.93."""

MEETS = 0.02
"""Metres within which the ends of two jaws are that meet."""

SWING, SLIDE = 0.4, 0.04
"""Radians or metres by which each finger is assumed to open, from where the pads touch, if the URDF
states no limits of its joint: other files give 0.6 to 1.2 and 0.03 to 0.05."""

SWEEP = 201
"""Positions of such fingers, within a radian or 0.1 m of the drawn one, among which pads touch."""


def read_gripper(path: Path | str, palm: str | None = None, cup: Cup | None = None) -> Gripper:
    """The gripper of a URDF on the link `palm`, else the first; ManipulationError for none.

    A suction cup is meant where `cup` states one, `palm` is a link that is one (`cup_links`), or
    nothing else is there.
    """
    robot = load_robot(path)
    cups = cup_links(robot)
    if cup is not None or palm in cups:
        return read_cup(robot, _cup_link(robot, palm, cups), cup)
    found, problems = _search(robot, None if palm is None else (palm,))
    if not found and palm is None and cups:
        return read_cup(robot, cups[0])
    return _first(found, problems, robot, path, palm)


def kept_gripper(path: Path | str, palm: str | None = None, cup: Cup | None = None) -> Gripper:
    """As `read_gripper`, the same one until the file changes: its grasps are kept with it.

    A palm without a stated cup is that of fingers, whatever its name.
    """
    path = Path(path).resolve()
    return _kept(path, path.stat().st_mtime_ns, palm, cup)


@lru_cache(maxsize=16)
def _kept(path: Path, changed: int, palm: str | None, cup: Cup | None) -> Gripper:
    if palm is not None and cup is None:
        return read_fingers(path, palm)
    found = read_gripper(path, palm, cup)
    return found if found.cup is not None else _kept(path, changed, found.palm, None)


def read_fingers(path: Path | str, palm: str | None = None) -> Gripper:
    """The gripper with fingers on the link `palm`, whatever its name, else the first.

    ManipulationError for none.
    """
    robot = load_robot(path)
    found, problems = _search(robot, None if palm is None else (palm,))
    return _first(found, problems, robot, path, palm)


def _first(
    found: Sequence[Gripper],
    problems: Sequence[str],
    robot: Robot,
    path: Path | str,
    palm: str | None,
) -> Gripper:
    if not found:
        which = "no link has" if palm is None else f"link {palm} does not have"
        why = "; ".join((*problems, *_fixed_fingers(robot)))
        raise ManipulationError(
            f"{path}: {which} two fingers that open{f' ({why})' if why else ''}. Give the URDF of "
            "a gripper, or of a robot with one, whose finger joints have limits; of a suction cup, "
            "state the radius"
        )
    return found[0]


def stated_cup(
    path: Path, palm: str | None, radius: float | None, force: float | None
) -> Cup | None:
    """The suction cup of a URDF by a radius in metres or a force in newtons; None without both.

    ManipulationError where only the force is stated, and the gripper is no suction cup.
    """
    if radius is None and force is not None:
        read = read_gripper(path, palm).cup
        if read is None:
            raise ManipulationError(
                f"{path}: its gripper has fingers, so force={force:g} says nothing; state the "
                "radius of a suction cup, too"
            )
        radius = read.radius
    return None if radius is None else Cup.of(radius, force)


def _cup_link(robot: Robot, palm: str | None, cups: Sequence[str]) -> str:
    """The link that is meant as the suction cup."""
    link = palm or next(iter(cups), None)
    if link is None:
        raise ManipulationError(
            f"{robot.name}: no link is named as a suction cup: palm=LINK names it"
        )
    if link not in robot.links:
        raise ManipulationError(
            f"{robot.name}: there is no link {link}{suggestion(link, robot.links)}"
        )
    return link


def find_grippers(robot: Robot, palms: Sequence[str] | None = None) -> list[Gripper]:
    """The grippers of a robot, in the order of its links; its suction cups if it has no fingers."""
    found = _search(robot, palms)[0]
    for link in () if found else cup_links(robot):
        if palms is None or link in palms:
            with suppress(ManipulationError):  # nothing tells its radius
                found.append(read_cup(robot, link))
    return found


def _search(robot: Robot, palms: Sequence[str] | None) -> tuple[list[Gripper], list[str]]:
    """The grippers of a robot, those with a jaw if there is no other; and why palms have none."""
    tree = LinkTree(robot)
    found: list[Gripper] = []
    problems: list[str] = []
    for palm, made in (*((p, _gripper) for p in tree.palms()), *((p, _jaw) for p in tree.jaws())):
        if made is _jaw and found:
            break
        if palms is None or palm in palms or set(tree.rigid(palm)) & set(palms):
            try:
                found.append(made(robot, tree, palm))
            except ManipulationError as error:
                if made is _gripper or palms is not None or not problems:
                    problems.append(f"{palm}: {error}")
    if len(found) > 1:
        found = [replace(each, name=f"{robot.name}/{each.palm}") for each in found]
    return found, problems


def _fixed_fingers(robot: Robot) -> list[str]:
    """A text about links that are named as fingers and do not move."""
    fixed = [j.child for j in robot.joints if not j.moves and "finger" in j.child.lower()]
    return [f"{', '.join(fixed[:3])} do not move"] if fixed else []


@dataclass
class _Finger:
    """A chain of moving joints, none of a jaw that does not move, with points on its links.

    `root` is the link whose origin it begins at.
    """

    root: str
    joints: list[Joint]
    links: tuple[str, ...]
    points: dict[str, Floats]


def _gripper(robot: Robot, tree: LinkTree, palm: str) -> Gripper:
    """The gripper of a palm; ManipulationError says why its fingers do not open."""
    fingers = []
    for joint in tree.moving(palm):
        chain = tree.chain(joint)
        assert chain is not None
        links = tuple(link for each in chain for link in tree.rigid(each.child))
        points = {link: _surface(robot.meshes[link]) for link in links if link in robot.meshes}
        if points:
            fingers.append(_Finger(chain[0].child, chain, links, points))
    if len(fingers) < 2:
        raise ManipulationError("its fingers have no meshes")
    robot = _with_limits(tree, palm, fingers)
    is_assumed = robot is not tree.robot
    tree = LinkTree(robot)
    opened, closed = _ends(tree, palm, fingers)
    if opened == closed:
        raise ManipulationError("the joints of its fingers have no limits")
    middle = {name: (opened[name] + closed[name]) / 2 for name in opened}
    poses = tree.poses(palm, middle)
    tips, roots = _tips(fingers, poses), _roots(fingers, poses)
    longest = float(np.linalg.norm(tips - roots, axis=1).max())
    if longest > FINGER:
        raise ManipulationError(f"what moves on it is {longest:.2g} m long: no finger")
    along = (tips - roots.mean(axis=0)) @ _unit(np.mean(tips - roots, axis=0))
    kept = [f for f, far in zip(fingers, along, strict=True) if far > 0.7 * along.max()]
    if len(kept) < 2:
        raise ManipulationError("its fingers do not point the same way where they are half open")
    hand = any(sum(j.mimics is None for j in f.joints) > 1 for f in kept)
    return _measured(
        tree, palm, fingers, kept, (opened, closed), STEPS // 4 if hand else 0, is_assumed
    )


def _jaw(robot: Robot, tree: LinkTree, palm: str) -> Gripper:
    """The gripper of a link that is a jaw, and of the one that moves on it."""
    (joint,) = tree.moving(palm)
    links = tuple(link for link in tree.rigid(palm) if link in tree.poses(palm, {}))
    moved = tree.rigid(joint.child)
    jaws = [
        _Finger(
            root, joints, some, {k: _surface(robot.meshes[k]) for k in some if k in robot.meshes}
        )
        for root, joints, some in ((palm, [], links), (joint.child, [joint], moved))
    ]
    if joint.type not in ("revolute", "prismatic") or not np.isfinite(joint.limits).all():
        raise ManipulationError("nothing opens on it")
    if not all(jaw.points for jaw in jaws):
        raise ManipulationError("its jaws have no meshes")
    apart = [_apart(jaws, tree.poses(palm, {joint.name: end})) for end in joint.limits]
    shut, wide = joint.limits if apart[0] < apart[1] else joint.limits[::-1]
    if joint.type == "revolute":
        wide = shut + float(np.clip(wide - shut, -WEDGE, WEDGE))
    if min(apart) > MEETS or abs(wide - shut) < 1e-3:
        raise ManipulationError("its jaws do not meet")
    ends = {joint.name: wide}, {joint.name: shut}
    return _measured(tree, palm, jaws, jaws, ends, STEPS // 2, False)


def _apart(jaws: Sequence[_Finger], poses: Mapping[str, Floats]) -> float:
    """Metres from the tip of the jaw that moves to the other one."""
    tip = _tip(jaws[1], poses)
    return float(np.linalg.norm(_placed(jaws[0], poses) - tip, axis=1).min())


def _measured(
    tree: LinkTree,
    palm: str,
    fingers: Sequence[_Finger],
    kept: Sequence[_Finger],
    ends_: tuple[dict[str, float], dict[str, float]],
    framed: int,
    is_assumed: bool,
) -> Gripper:
    """The gripper of fingers, of which those that are `kept` touch objects.

    `ends_` are the open and the closed positions of joints; of the postures between them, that of
    number `framed` has the grasp frame.
    """
    robot, (opened, closed) = tree.robot, ends_
    hand = any(sum(j.mimics is None for j in f.joints) > 1 for f in kept)
    one_jaw = not all(f.joints for f in kept)
    fractions = np.linspace(0, 1, STEPS)
    postures = [
        {name: opened[name] + s * (closed[name] - opened[name]) for name in opened}
        for s in fractions
    ]
    placed = [tree.poses(palm, posture) for posture in postures]
    if one_jaw:
        kept = [_jaw_end(kept, placed[-1]), kept[1]]
    frame, sides = _frame(kept, placed[framed], hand)
    inverse = np.linalg.inv(frame)
    seen = [{k: inverse @ pose for k, pose in poses.items()} for poses in placed]
    measured = [_measure(kept, sides, poses) for poses in seen]
    if not hand:  # the parts that touch each other when closed are the pads, however fingers turn
        touching = next((n for n, m in enumerate(measured) if m.width <= TOUCH), len(measured) - 1)
        pads = _pads(kept, seen[touching])
        measured = [_measure(kept, sides, poses, pads) for poses in seen]
    widths = [m.width for m in measured]
    first, last = _closing(widths)
    if widths[first] - widths[last] < 5e-3:
        raise ManipulationError("its fingers do not open")
    if widths[first] > WIDEST:
        raise ManipulationError(f"what moves on it opens {widths[first]:.2g} m: no fingers")
    chosen = slice(first, last + 1)
    postures, measured, placed = postures[chosen], measured[chosen], placed[chosen]
    opened_at, ends = measured[0], np.array([m.end for m in measured])
    middle_y = float(np.mean(opened_at.across))
    frame[:3, 3] += frame[:3, :3] @ [opened_at.middle, middle_y, ends[0] - PAD / 2]
    inverse = np.linalg.inv(frame)
    rigid = tuple(link for link in tree.rigid(palm) if link in robot.meshes)
    at_rest = robot.link_poses({}, (palm, *rigid))
    placed_at = {k: inverse @ np.linalg.inv(at_rest[palm]) @ at_rest[k] for k in rigid}
    rigid = tuple(k for k in rigid if not _is_margin(robot, k, placed_at[k]))
    hulls = {k: [robot.hull(k)] for k in rigid}
    if one_jaw:  # the hull of a jaw and its mount fills what the other one closes
        hulls = {k: _slices(robot.meshes[k], placed_at[k]) for k in rigid}
    rigid = tuple(k for k in rigid for _ in hulls[k])
    moved = tuple(link for f in fingers if f.joints for link in f.links if link in robot.meshes)
    links, fixed = rigid + moved, [placed_at[link] for link in rigid]
    poses_all = np.array([[*fixed, *(inverse @ poses[k] for k in moved)] for poses in placed])
    between = opened_at.width / (4 if one_jaw else 2)
    each, first_of = np.unique(rigid, return_index=True)
    front = _front(robot, each.tolist(), poses_all[0][first_of], between)
    beside = np.array(opened_at.across)[np.array(sides) > 0] - middle_y
    series = np.maximum([m.width for m in measured], 0.0)
    aside = np.zeros(len(series))
    if one_jaw:  # the moving jaw brings the object to the other one
        aside = sides[0] * (series[0] - series) / 2
    return Gripper(
        robot.name,
        "multi-finger" if hand else "parallel",
        palm,
        frame,
        tuple(f.links for f in kept),
        tuple(postures),
        series,
        ends - ends[0],
        max(0.0, -front),
        beside if hand else np.zeros(1),
        not one_jaw and _is_symmetric(robot, links, poses_all[0], (palm, *moved)),
        links,
        poses_all,
        robot,
        (*(hull for k in dict.fromkeys(rigid) for hull in hulls[k]), *map(robot.hull, moved)),
        aside,
        fixed_vertical(robot, palm, frame),
        is_assumed,
    )


def _jaw_end(jaws: Sequence[_Finger], closed: Mapping[str, Floats]) -> _Finger:
    """The part of the fixed jaw that the end of the other one meets."""
    fixed, tip = jaws[0], _tip(jaws[1], closed)
    near = {
        link: points[np.linalg.norm(transformed(points, closed[link]) - tip, axis=1) < 1.5 * PAD]
        for link, points in fixed.points.items()
    }
    return replace(fixed, points={link: points for link, points in near.items() if len(points)})


def _slices(mesh: Mesh, pose: Floats) -> list[Floats]:
    """Corners (N, 3) of the hulls of a link's slices along the approach, in the link's frame.

    `pose` (4, 4) is that of the link in the grasp frame.
    """
    import trimesh  # slow to load

    whole = trimesh.Trimesh(transformed(mesh.vertices, pose), mesh.faces)
    low, high = whole.bounds[:, 2]
    levels = np.linspace(low, high, max(2, int(np.ceil((high - low) / SLICE)) + 1))
    found = []
    for below, above in pairwise(levels):
        part = whole.slice_plane((0, 0, below), (0, 0, 1)).slice_plane((0, 0, above), (0, 0, -1))
        if len(part.vertices) > 3 and np.ptp(part.vertices, axis=0).min() > 1e-6:
            corners = hull_points(Mesh(np.asarray(part.vertices), np.asarray(part.faces)))
            found.append(transformed(corners, np.linalg.inv(pose).astype(np.float64)))
    return found


def _with_limits(tree: LinkTree, palm: str, fingers: Sequence[_Finger]) -> Robot:
    """The robot, with assumed limits of finger joints if the URDF states none of them.

    Both limits are 0 there, or missing. The fingers then open from where their pads touch.
    """
    joints = {j.mimics or j.name: j for f in fingers for j in f.joints}
    joints = {j.name: j for j in tree.robot.joints if j.name in joints}
    if any(np.isfinite(j.limits).all() and any(j.limits) for j in joints.values()):
        return tree.robot
    frame, sides = _frame(fingers, tree.poses(palm, {}), hand=False)
    inverse = np.linalg.inv(frame)

    def apart(posture: Mapping[str, float]) -> float:
        tips = _tips(fingers, tree.poses(palm, posture))
        return float((tips @ frame[:3, 0]) @ np.array(sides))

    def width(posture: Mapping[str, float]) -> float:
        poses = tree.poses(palm, posture)
        return _measure(fingers, sides, {k: inverse @ pose for k, pose in poses.items()}).width

    unit = {name: 1.0 if j.type == "revolute" else SLIDE / SWING for name, j in joints.items()}
    opening = {n: u * np.sign(apart({n: 0.01 * u}) - apart({})) for n, u in unit.items()}
    swept = np.linspace(-1, 1, SWEEP)
    widths = np.array([width({n: t * u for n, u in opening.items()}) for t in swept])
    last = max(np.flatnonzero(widths <= 0), default=-1)
    if last in (-1, len(swept) - 1):
        return tree.robot
    touch = float(np.interp(0, widths[last : last + 2], swept[last : last + 2]))
    ends = np.array([min(touch, 0.0), max(touch + SWING, 0.0)])
    limits = {n: tuple(sorted((ends * u).tolist())) for n, u in opening.items()}
    changed = (replace(j, limits=limits.get(j.name, j.limits)) for j in tree.robot.joints)
    return replace(tree.robot, joints=tuple(changed))


def _closing(widths: Sequence[float]) -> tuple[int, int]:
    """The postures between which the width falls, from the widest to touching pads."""
    first = last = int(np.argmax(widths))
    while last + 1 < len(widths) and widths[last] > TOUCH and widths[last + 1] < widths[last]:
        last += 1
    return first, last


def _unit(vector: Floats) -> Floats:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)


def _surface(mesh: Mesh) -> Floats:
    """(N, 3) points on a mesh, the same in each run."""
    corners = mesh.triangles
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    if areas.sum() == 0:
        return mesh.used
    random = np.random.default_rng(0)
    face = random.choice(len(corners), SAMPLES, p=areas / areas.sum())
    u, v = random.random((2, SAMPLES))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = np.moveaxis(corners[face], 1, 0)
    return np.concatenate([a + u[:, None] * (b - a) + v[:, None] * (c - a), mesh.used])


def _placed(finger: _Finger, poses: Mapping[str, Floats]) -> Floats:
    return np.concatenate([transformed(points, poses[k]) for k, points in finger.points.items()])


def _tip(finger: _Finger, poses: Mapping[str, Floats]) -> Floats:
    """The middle of the tenth of a finger's points that is farthest from its first joint."""
    points = _placed(finger, poses)
    far = np.linalg.norm(points - poses[finger.root][:3, 3], axis=1)
    tip: Floats = points[far >= np.quantile(far, 0.9)].mean(axis=0)
    return tip


def _ends(
    tree: LinkTree, palm: str, fingers: Sequence[_Finger]
) -> tuple[dict[str, float], dict[str, float]]:
    """The open and the closed positions of the joints that do not mimic others."""
    known = {joint.name: joint for joint in tree.robot.joints}
    names = list(dict.fromkeys(j.mimics or j.name for f in fingers for j in f.joints))
    limits = {name: known[name].limits for name in names}
    rest = {name: min(max(0.0, low), high) for name, (low, high) in limits.items()}
    opened, closed = dict(rest), dict(rest)
    single = all(len({j.mimics or j.name for j in f.joints}) == 1 for f in fingers)
    middle = {name: (low + high) / 2 for name, (low, high) in limits.items()}
    outward = _tips(fingers, tree.poses(palm, middle))
    outward -= outward.mean(axis=0)
    for name, (low, high) in limits.items():
        if not np.isfinite((low, high)).all():
            continue
        if single:
            gaps = []
            for end in (low, high):
                tips = _tips(fingers, tree.poses(palm, middle | {name: end}))
                gaps.append(float(np.sum((tips - tips.mean(axis=0)) * outward)))
            opened[name], closed[name] = (low, high) if gaps[0] > gaps[1] else (high, low)
        elif high > -2 * low or -low > 2 * high:  # bends; else it spreads the fingers
            closed[name] = high if high > -low else low
    if not single:  # a thumb opposes the fingers before the hand closes
        for finger in fingers:
            first = finger.joints[0].name
            if len(finger.joints) > 2 and first in opened:
                opened[first] = closed[first]
    return opened, closed


def _tips(fingers: Sequence[_Finger], poses: Mapping[str, Floats]) -> Floats:
    return np.array([_tip(f, poses) for f in fingers])


def _roots(fingers: Sequence[_Finger], poses: Mapping[str, Floats]) -> Floats:
    return np.array([poses[f.root][:3, 3] for f in fingers])


def _frame(
    fingers: Sequence[_Finger], poses: Mapping[str, Floats], hand: bool
) -> tuple[Floats, list[int]]:
    """The axes of the grasp frame in the palm's frame, and the side (-1 or 1) of each finger."""
    tips, roots = _tips(fingers, poses), _roots(fingers, poses)
    if hand:
        apart = [np.linalg.norm(t - np.delete(tips, i, 0).mean(axis=0)) for i, t in enumerate(tips)]
        thumb = int(np.argmax(apart))
        x = np.delete(tips, thumb, 0).mean(axis=0) - tips[thumb]
        sides = [-1 if i == thumb else 1 for i in range(len(tips))]
    else:
        spread = tips - tips.mean(axis=0)
        x = np.linalg.svd(spread, full_matrices=False)[2][0]
        x *= np.sign(x[np.argmax(np.abs(x))])
        sides = [1 if s > 0 else -1 for s in spread @ x]
    x = _snapped(x)
    z = tips.mean(axis=0) - roots.mean(axis=0)
    z = _snapped(z - (z @ x) * x)
    z = _unit(z - (z @ x) * x)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    thumb_side = tips[np.array(sides) < 0].mean(axis=0)
    frame[:3, 3] = (thumb_side + tips[np.array(sides) > 0].mean(axis=0)) / 2
    return frame, sides


def _snapped(vector: Floats) -> Floats:
    """The axis of the palm within 15 degrees of a direction, else the direction."""
    vector = _unit(vector)
    axis = int(np.argmax(np.abs(vector)))
    if abs(vector[axis]) < np.cos(np.radians(15)):
        return vector
    return np.asarray(np.eye(3)[axis] * np.sign(vector[axis]))


class _Measures(NamedTuple):
    """The width between the pads, x of their middle, z of the ends, and y of each finger's pad."""

    width: float
    middle: float
    end: float
    across: list[float]


def _pads(fingers: Sequence[_Finger], poses: Mapping[str, Floats]) -> list[NDArray[np.bool_]]:
    """Which points of each finger are at its end in a posture, in the frame of the poses."""
    ends = [_placed(finger, poses)[:, 2] for finger in fingers]
    return [z > z.max() - PAD for z in ends]


def _measure(
    fingers: Sequence[_Finger],
    sides: Sequence[int],
    poses: Mapping[str, Floats],
    pads: Sequence[NDArray[np.bool_]] | None = None,
) -> _Measures:
    """The width between pads, by default the points that are at the ends in this posture."""
    inner = {-1: [], 1: []}  # type: dict[int, list[float]]
    ends, across = [], []
    for number, (finger, side) in enumerate(zip(fingers, sides, strict=True)):
        points = _placed(finger, poses)
        ends.append(float(points[:, 2].max()))
        pad = points[points[:, 2] > ends[-1] - PAD if pads is None else pads[number]]
        inner[side].append(float((pad[:, 0] * side).min()))
        across.append(float((pad[:, 1].min() + pad[:, 1].max()) / 2))
    left, right = min(inner[-1]), min(inner[1])
    return _Measures(left + right, (right - left) / 2, float(np.mean(ends)), across)


def _is_margin(robot: Robot, link: str, pose: Floats) -> bool:
    """Whether a link is a box around the whole hand: not seen, and between the pads as well."""
    if robot.is_seen(link):
        return False
    planes = ConvexHull(robot.hull(link), qhull_options="QJ").equations
    between = np.linalg.inv(pose)[:3, 3]  # the origin of the grasp frame
    return bool((planes[:, :3] @ between + planes[:, 3] < 0).all())


def _front(robot: Robot, rigid: Sequence[str], poses: Floats, between_x: float) -> float:
    """The highest z of the palm between the fingers, in the grasp frame."""
    if not rigid:
        return -0.1
    points = np.concatenate(
        [
            _surface(robot.meshes[link]) @ pose[:3, :3].T + pose[:3, 3]
            for link, pose in zip(rigid, poses, strict=False)
        ]
    )
    between = (np.abs(points[:, 0]) < between_x) & (np.abs(points[:, 1]) < PAD)
    return float(points[between, 2].max()) if between.any() else float(points[:, 2].max())


def _is_symmetric(
    robot: Robot, links: Sequence[str], poses: Floats, compared: Sequence[str]
) -> bool:
    """Whether half a turn about the approach moves no surface by more than some millimetres."""
    whole = join(
        [
            Mesh(transformed(robot.meshes[link].vertices, pose), robot.meshes[link].faces)
            for link, pose in zip(links, poses, strict=True)
            if link in compared and link in robot.meshes
        ]
    )
    points = _surface(whole)
    apart = cKDTree(points).query(points * [-1, -1, 1])[0]
    return bool(np.quantile(apart, 0.95) < 0.012)

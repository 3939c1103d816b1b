"""Grasp candidates and their collisions in a furnished room, beside another engine."""

from __future__ import annotations

import importlib.metadata
import os
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from benchmarks.timing import Row, median_seconds, print_rows
from semmap.arrays import Floats
from semmap.geometry.pose import IDENTITY
from semmap.ingest.sdf.world_file import read_sdf
from semmap.manipulation.arm import Arm
from semmap.manipulation.candidates import Grasps, grasp_candidates
from semmap.manipulation.collision import Obstacles, free_grasps
from semmap.manipulation.gripper_reader import read_gripper
from semmap.manipulation.solids import solid_of
from semmap.manipulation.trial import Trial, body_of
from semmap.perception.primitives import Primitive

__all__ = ["main"]

CANDIDATES = 136


def house() -> Floats:
    """The visual triangles of the small house, (F, 3, 3), map's frame."""
    worlds = Path(os.environ.get("SEMMAP_WORLDS", "../shared/worlds"))
    world = read_sdf(worlds / "small_house" / "worlds" / "small_house.world")
    return np.concatenate(
        [
            s.mesh.moved(e.pose or IDENTITY).triangles
            for e in world.entries
            for s in e.shapes
            if s.mesh is not None
        ]
    )


def by_trimesh(
    grasps: Grasps, model: Floats, triangles: Floats
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """The same by trimesh's manager of python-fcl, which holds the room as a mesh."""
    gripper = grasps.gripper
    engine: Any = trimesh
    manager = engine.collision.CollisionManager()
    manager.add_object("room", engine.Trimesh(**engine.triangles.to_kwargs(triangles)))
    free = np.ones(len(grasps), bool)
    for i, grasp in enumerate(grasps):
        back = (np.linalg.inv(grasp.pose) @ grasp.pre_grasp)[:3, 3]
        shut = gripper.index(grasp.width or 0.0)
        for number, link in enumerate(gripper.links):
            corners = gripper.robot.hull(link)
            at = gripper.poses[0, number]
            points = corners @ at[:3, :3].T + at[:3, 3]
            hulls = [np.concatenate([points, points + back])]
            if any(link in finger for finger in gripper.fingers):
                at = gripper.poses[shut, number]
                hulls.append(corners @ at[:3, :3].T + at[:3, 3])
            for hull in hulls:
                mesh = engine.convex.convex_hull(hull)
                if manager.in_collision_single(mesh, model @ grasp.pose):
                    free[i] = False
    return free


def main() -> None:
    """Print the table."""
    files = importlib.metadata.files("example-robot-data") or []
    urdf = next(f for f in files if str(f).endswith("panda_description/urdf/panda.urdf"))
    gripper = read_gripper(Path(str(urdf.locate())))
    shape = Primitive("cuboid", (0.05, 0.06, 0.12), np.eye(4), 1.0, (0.0, 0.0, 0.0), 0.001)
    solid = solid_of(shape.kind, shape.size)
    model = np.eye(4)
    model[:3, 3] = 6.55, 0.95, 0.862  # on the kitchen table
    triangles = house()
    room = Obstacles(triangles)
    grasps = grasp_candidates(shape, gripper)
    some = grasps[:CANDIDATES]
    made = median_seconds(lambda: grasp_candidates(shape, gripper), times=21)
    first = median_seconds(
        lambda: free_grasps(grasps[:CANDIDATES], model, room), times=1, warm_up=0
    )
    ours = median_seconds(lambda: free_grasps(some, model, room), times=11)
    near = room.within(model[:3, 3] - 0.6, model[:3, 3] + 0.6).triangles
    theirs = median_seconds(lambda: by_trimesh(some, model, near), times=1, warm_up=0)
    same = int((free_grasps(some, model, room) != by_trimesh(some, model, near)).sum())
    arm = Arm(gripper)
    random = np.random.default_rng(0)
    wanted = [arm.grasp_pose(random.uniform(arm.low, arm.high)) for _ in range(20)]
    reached = [arm.reach(pose) is not None for pose in wanted]
    inverse = median_seconds(lambda: [arm.reach(pose) for pose in wanted], times=1, warm_up=0)
    standing = np.eye(4)
    standing[2, 3] = 0.0605
    trial = Trial(gripper, body_of(solid), standing)
    tried = median_seconds(lambda: trial.run(grasps[0]), times=5)
    print_rows(
        "Manipulation: candidates, collisions, arms, trials",
        [
            Row(
                f"{len(grasps)} grasps of a block, Panda",
                f"{1e3 * made:.1f} ms",
                "the ROS tool: 136 poses for a block",
                "at least 136",
                len(grasps) >= CANDIDATES,
            ),
            Row(
                f"{CANDIDATES} candidates against {len(triangles):,} triangles, swept",
                f"{1e3 * ours:.1f} ms (the first time {1e3 * first:.0f} ms)",
                f"trimesh and python-fcl: {theirs:.2f} s, {theirs / ours:.0f}x; {same} differ",
                "under 50 ms",
                ours < 0.05 and same == 0,
            ),
            Row(
                "inverse kinematics, random poses of 7 joints",
                f"{1e3 * inverse / len(wanted):.0f} ms",
                f"{sum(reached)} of {len(wanted)} reached",
                "at least 90 %",
                sum(reached) >= 0.9 * len(wanted),
            ),
            Row(
                "a trial of 2.1 s in simulation",
                f"{1e3 * tried:.0f} ms",
                "-",
                "under 0.5 s",
                tried < 0.5,
            ),
        ],
    )


if __name__ == "__main__":
    main()

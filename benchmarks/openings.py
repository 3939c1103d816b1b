"""First attempts at cabinets at random, through the map: does the robot open their doors?

`Map.openings` names the way; a simulation of the part on its joint tries it with a mass, frictions
of the pads and of the joint, and an error of the handle's pose, with its axis, that the map does
not know. Success: 90 % of the way, and the pads are on the handle.
"""

from __future__ import annotations

import sys
import tempfile
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from rich.progress import track

import semmap
from benchmarks.bench_map import fresh_map
from benchmarks.grasp_experiment import HEADING, POSITION, interval, urdf
from benchmarks.timing import Row, print_rows
from semmap.arrays import Floats
from semmap.geometry.mesh import Mesh
from semmap.manipulation.evaluation import opening_mismatch
from semmap.manipulation.gripper_reader import read_gripper
from semmap.manipulation.handles import part_pieces
from semmap.manipulation.moving_part import MovingPart
from semmap.manipulation.part_motion import PartMotion
from semmap.manipulation.part_trial import PartTrial, Resistance
from semmap.manipulation.reader import in_model
from semmap.manipulation.trial import body_of
from tests.manipulation.cabinets import Cabinet, Form, Kind
from tests.seen import seen_by

CABINETS, TRIALS = 10, 4
"""Cabinets of each kind and handle, and trials of each by each gripper."""

KINDS: tuple[Kind, ...] = ("door", "drawer")
FORMS: tuple[Form, ...] = ("bar", "knob")


def attempts(
    home: semmap.Map, cabinet: Cabinet, robot: str, random: np.random.Generator
) -> list[str]:
    """How trials of the way end that the map names first; "none" where it names none."""
    found = home.openings(cabinet.kind, gripper=robot, limit=1)
    if not found:
        return ["none"] * TRIALS
    row = found[0]
    part = MovingPart.of(seen_by(home.connection), cabinet.kind)
    motion = PartMotion.of_numbers(row["motion"])
    surface = Mesh(np.asarray(part.mesh.vertices), np.asarray(part.mesh.faces, np.int32))
    pieces, hand = part_pieces(part.mesh, motion), read_gripper(urdf(robot))
    pose, before, told = row["model_pose"].matrix, in_model(row, "pre_pose"), []
    for _ in range(TRIALS):
        usual = body_of(surface, pieces=pieces).mass
        body = body_of(
            surface,
            mass=usual * random.uniform(0.7, 1.3),
            friction=random.uniform(0.4, 0.8),
            pieces=pieces,
        )
        slack = random.uniform(0.2, 1)
        resistance = Resistance(2 * slack, slack) if motion.is_hinge else Resistance(10 * slack, 10)
        trial = PartTrial(hand, body, np.eye(4), motion, resistance)
        error = error_at(np.array(cabinet.handle_at), random)
        told.append(opening_mismatch(trial.open(pose, before, row["pre_posture"], error=error)))
    return [cause or "completed" for cause in told]


def error_at(handle: Floats, random: np.random.Generator) -> Floats:
    """How wrong a robot sees a handle, and the axis with it: (4, 4) in the frame of the part."""
    error = np.eye(4)
    turn = random.normal(0, HEADING)
    error[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    error[:3, 3] = handle - error[:3, :3] @ handle + random.normal(0, POSITION, 3)
    return error


def kitchen(cabinet: Cabinet, robot: str, db: semmap.Database) -> semmap.Map:
    """A map with a cabinet, for a gripper that knows nothing."""
    db.session.execute("DELETE FROM object_model")
    db.add_gripper(urdf(robot), name=robot)
    with tempfile.TemporaryDirectory() as folder:
        db.import_file(cabinet.write(Path(folder) / "cabinet.urdf"), map="openings")
    return db.map("openings")


def main(cabinets: int = CABINETS) -> None:
    """Print the share of successes of each kind of cabinet by both grippers."""
    rows, random = [], np.random.default_rng(5)
    for kind, form, robot in product(KINDS, FORMS, ("panda", "pr2")):
        told: list[str] = []
        for seed in track(range(cabinets), f"{robot}: {kind}, {form}", transient=True):
            cabinet = Cabinet.random(1000 + seed, kind, form)
            with fresh_map("openings", partial(kitchen, cabinet, robot)) as (_, home):
                told += attempts(home, cabinet, robot, random)
        done = told.count("completed")
        share, low, high = interval(done, len(told))
        causes = [f"{each} {told.count(each)}" for each in sorted({*told} - {"completed"})]
        rows.append(
            Row(
                f"{robot}: {kind}, {form}, {cabinets} cabinets",
                f"{100 * share:.0f} % ({100 * low:.0f} to {100 * high:.0f}), {len(told)} attempts",
                ", ".join(causes),
                "at least 80 %",
                share >= 0.8,
            )
        )
        print(rows[-1], flush=True)
    print_rows(f"First attempts, {TRIALS} of each cabinet", rows)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

"""First attempts at objects that nobody tuned for, through the map: does the robot hold them?

Objects of the YCB set with their weights, those of worlds that a hand could take, and hollow things
at random stand on a table of a map. `Map.grasps` names the grasp; a simulation with the convex
pieces of the mesh tries it, with a mass, a friction, a balance and an error of the pose that the
map does not know.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh
from rich.progress import track
from scipy.stats import binomtest

import semmap
from benchmarks.bench_map import fresh_map
from benchmarks.grasp_experiment import HEADING, POSITION, urdf
from benchmarks.recognition import ycb_meshes
from benchmarks.timing import Row, print_rows
from semmap.geometry.mesh import Mesh
from semmap.ingest.meshes.mesh_file import read_mesh
from semmap.ingest.meshes.mesh_size import MeshFileError
from semmap.manipulation.candidates import Grasp
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.evaluation import mismatch
from semmap.manipulation.ranking import grasp_of_row
from semmap.manipulation.retrieval import stored_gripper
from semmap.manipulation.trial import HEIGHT, Trial, TrialOutcome, body_of
from tests.manipulation.grippers import SUCTION
from tests.manipulation.hollow_things import boxes, cup, mug, plate

WORLDS = Path(os.environ.get("SEMMAP_WORLDS", "../shared/worlds"))
TRIALS = 12
"""Trials of each object and gripper."""

GRIPPERS = ("panda", "pr2", "cup")
"""The third one is a suction cup of 30 mm and 60 N, with a stem of 45 mm before a box of 6 cm."""

TABLE, GAP = 0.7, 5e-4
WEIGHTS = {
    "cracker_box": 0.411,
    "sugar_box": 0.514,
    "tomato_soup_can": 0.349,
    "mustard_bottle": 0.603,
    "gelatin_box": 0.097,
    "potted_meat_can": 0.370,
}
"""Kilograms, from the list of the YCB set."""

DENSITY, LIGHTEST, HEAVIEST = 300.0, 0.05, 0.6
"""Of other objects: kg/m³ of their hull, within these kilograms."""

LARGEST, SMALLEST = 0.3, 0.08
"""Metres: objects are at most that long, and at least one of their sides is at most so wide."""


@dataclass(frozen=True)
class Thing:
    """A mesh, z up, and its mass in kg."""

    name: str
    mesh: Mesh
    mass: float


@dataclass
class Score:
    """Attempts, after how many the object is in the hand, and how many went as expected.

    An object is in the hand if it is above half of the way that it was lifted, after a shake.
    """

    attempts: int = 0
    held: int = 0
    expected: int = 0
    without: list[str] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def add(self, outcome: TrialOutcome) -> None:
        """Count an attempt."""
        self.attempts += 1
        self.held += outcome.lifted > HEIGHT / 2
        self.expected += mismatch(outcome) is None

    def text(self, count: int) -> str:
        """A share of the attempts, with its 95 % interval."""
        if not self.attempts:
            return "none"
        found = binomtest(count, self.attempts).proportion_ci(method="wilson")
        share = 100 * count / self.attempts
        return f"{share:.0f} % ({100 * found.low:.0f} to {100 * found.high:.0f})"


def ycb() -> list[Thing]:
    """The objects of the YCB set that are at hand."""
    return [Thing(name, mesh, WEIGHTS[name]) for name, mesh in ycb_meshes(WORLDS).items()]


def of_world(folder: str) -> list[Thing]:
    """The models of a world that are small enough for a hand."""
    found = []
    for file in sorted((WORLDS / folder / "models").glob("*/meshes/*visual*")):
        try:
            mesh = read_mesh(file, dae_up_axis=False)
        except MeshFileError:  # some are cut off
            continue
        size = np.sort(np.ptp(mesh.used, axis=0))
        if 0.005 < size[0] <= SMALLEST and size[2] <= LARGEST:
            found.append(weighed(file.parent.parent.name, mesh))
    return found


def hollow() -> list[Thing]:
    """A cup, a mug, a plate, and boxes at random, as they lie."""
    random = np.random.default_rng(11)
    made = {"cup": cup(), "mug": mug(), "plate": plate()}
    made |= {f"boxes {number}": boxes(random) for number in range(5)}
    found = [
        weighed(name, Mesh(np.asarray(each.vertices), np.asarray(each.faces, np.int32)))
        for name, each in made.items()
    ]
    return [each if "boxes" not in each.name else in_any_rest(each) for each in found]


def weighed(name: str, mesh: Mesh) -> Thing:
    """A thing of about the mass that its hull lets expect."""
    volume = trimesh.convex.convex_hull(mesh.used).volume
    return Thing(name, mesh, float(np.clip(DENSITY * volume, LIGHTEST, HEAVIEST)))


def in_any_rest(thing: Thing) -> Thing:
    """The same thing as it most probably lies where it was dropped."""
    whole = trimesh.Trimesh(thing.mesh.vertices, thing.mesh.faces)
    poses, shares = trimesh.poses.compute_stable_poses(whole.convex_hull, n_samples=1)
    turn = poses[int(np.argmax(shares))][:3, :3]
    return Thing(
        f"{thing.name} dropped", Mesh(thing.mesh.vertices @ turn.T, thing.mesh.faces), thing.mass
    )


def attempts(
    home: semmap.Map, robot: str, thing: Thing, score: Score, random: np.random.Generator
) -> None:
    """Trials of the grasp that the map names first."""
    height = TABLE + GAP - float(thing.mesh.used[:, 2].min())
    home.add_object(thing.name, mesh=thing.mesh, pose=(0, 0, height))
    try:
        start = time.perf_counter()
        found = home.grasps(thing.name, gripper=robot, limit=1)
        score.seconds.append(time.perf_counter() - start)
        if not found:
            score.without.append(thing.name)
            return
        hand = stored_gripper(home.database.session, robot)
        grasp = grasp_of_row(found[0], hand.opening)
        standing = np.eye(4)
        standing[2, 3] = height - TABLE
        for _ in range(TRIALS):
            body = body_of(
                thing.mesh,
                mass=thing.mass * random.uniform(0.7, 1.3),
                friction=random.uniform(0.4, 0.8),
                offset=random.normal(0, 0.005, 3).tolist(),
            )
            score.add(wrongly_seen(Trial(hand, body, standing), grasp, random))
    except ManipulationError:
        score.without.append(thing.name)
    finally:
        home[thing.name].delete()


def wrongly_seen(trial: Trial, grasp: Grasp, random: np.random.Generator) -> TrialOutcome:
    """A trial by a robot that sees the object beside where it is."""
    error = np.eye(4)
    error[:2, 3] = random.normal(0, POSITION, 2)
    turn = random.normal(0, HEADING)
    error[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    return trial.run(grasp, error=error)


def kitchen(db: semmap.Database) -> semmap.Map:
    """A map with a table, and all grippers."""
    for robot in ("panda", "pr2"):
        db.add_gripper(urdf(robot), name=robot)
    file = Path(os.environ["SEMMAP_DATA"]) / "one_cup.urdf"
    file.write_text(SUCTION)
    db.add_gripper(file, name="cup", suction=0.015, force=60)
    home = db.create_map("grasping")
    home.add_object("table", type="table", size=(1.2, 1.2, TABLE), pose=(0, 0, 0))
    return home


SETS: dict[str, Callable[[], list[Thing]]] = {
    "YCB, upright": ycb,
    "YCB, dropped": lambda: [in_any_rest(thing) for thing in ycb()],
    "small_house": lambda: of_world("small_house"),
    "bookstore": lambda: of_world("bookstore"),
    "hollow things": hollow,
}


def main() -> None:
    """Print the table."""
    rows = []
    with fresh_map("grasping", kitchen) as (db, home):
        db.session.execute("DELETE FROM object_model")  # what other runs learned
        for name, made in SETS.items():
            things = made()
            for robot in GRIPPERS:
                score, random = Score(), np.random.default_rng(5)
                for thing in track(things, f"{name}, {robot}", transient=True):
                    attempts(home, robot, thing, score, random)
                rows.append(_row(name, robot, len(things), score))
    print_rows(f"First attempts, {TRIALS} of each object", rows)


def _row(name: str, robot: str, things: int, score: Score) -> Row:
    without = f"; no grasp of {', '.join(score.without)}" if score.without else ""
    asked = name == "YCB, upright" and robot != "cup"
    seconds = np.median(score.seconds or [0])
    return Row(
        f"{name}, {robot}: {things - len(score.without)} of {things} objects held",
        f"{score.text(score.held)}, {score.attempts} attempts",
        f"as expected {score.text(score.expected)}; {seconds:.1f} s to generate{without}",
        "at least 90 %" if asked else "",
        not asked or score.held >= 0.9 * score.attempts,
    )


if __name__ == "__main__":
    main()

"""The paper's experiment (Tosello et al., section IV-D), repeated over many random objects.

    python -m benchmarks grasp_experiment                    # the table; 30 minutes on two cores
    python -m benchmarks.grasp_experiment --draw FILE.png    # and the curve

A robot meets one object after another: cuboids, cylinders, spheres and cones of random size, mass,
friction and balance, whose pose it sees with an error. It practises each one: `practise` takes the
grasps in the order in which `find_grasps` proposes them, until one succeeds, and stores what it
learns in the database. Then it meets the same object again. At each object, a robot without
knowledge takes the grasp that `find_grasps` proposes where no outcome is trusted; it sees the
object with the same error. A pupil with another gripper tries one grasp of each of these objects,
and then of new ones; it knows the outcomes of its teacher alone, since its own are not stored.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import multiprocessing
import os
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from copy import copy
from itertools import chain, count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psycopg
from numpy.typing import NDArray

import semmap
from benchmarks.timing import Row, print_rows
from semmap import Map
from semmap.database import Cluster
from semmap.geometry.mesh import Mesh
from semmap.manipulation.candidates import Grasp
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.evaluation import mismatch
from semmap.manipulation.practice import practise
from semmap.manipulation.ranking import grasp_of_row
from semmap.manipulation.retrieval import find_grasps, generate, register_gripper, stored_gripper
from semmap.manipulation.solids import solid_of
from semmap.manipulation.trial import Trial, TrialOutcome, body_of
from tests.seen import seen_by

__all__ = ["Meeting", "live", "main"]

Floats = NDArray[np.float64]

ROBOTS = {"panda": "panda_description/urdf/panda.urdf", "pr2": "pr2_description/urdf/pr2.urdf"}

POSITION, HEADING = 0.004, 0.05
"""Standard deviations of a seen pose: metres, radians."""

TABLE = 0.75
"""Metres from the floor to the table's top."""

GAP = 5e-4
"""Metres between the table and what stands on it."""

RUNS, OBJECTS, NEW = 6, 60, 40
"""Runs of each robot, objects of a run, and new objects that a pupil meets after it."""


TAUGHT = ("taught by the other one, same objects", "taught by the other one, new objects")
"""What a pupil tries: objects after its teacher, and then others."""


class Item(NamedTuple):
    """A random object."""

    kind: str
    size: tuple[float, ...]
    rotation: Floats  # of the solid in the frame of the model
    mass: float
    friction: float
    offset: tuple[float, ...]


class Meeting(NamedTuple):
    """What happened with one object."""

    blind: bool  # the first attempt without knowledge
    knowing: bool  # the first attempt with knowledge of earlier objects
    attempts: int  # until success, with knowledge
    learned: bool
    again: bool  # the first attempt at a second meeting


class Life(NamedTuple):
    """The meetings of a robot, and those of its pupil with the same and with new objects."""

    own: list[Meeting]
    same: list[Meeting]
    new: list[Meeting]


def random_item(random: np.random.Generator) -> Item:
    """Containers: half full, so that their centre of mass lies below the middle and beside it."""
    kind = str(random.choice(["cuboid", "cylinder", "sphere", "cone"]))
    size: tuple[float, ...]
    if kind == "cuboid":
        size = (
            random.uniform(0.03, 0.065),
            random.uniform(0.03, 0.065),
            random.uniform(0.06, 0.25),
        )
        if random.random() < 0.6:  # lies
            size = (size[2], size[0], size[1])
    elif kind == "sphere":
        size = (random.uniform(0.018, 0.035),)
    elif kind == "cone":
        size = (random.uniform(0.02, 0.035), random.uniform(0.08, 0.2))
    else:
        size = (random.uniform(0.015, 0.035), random.uniform(0.05, 0.25))
    rotation = np.eye(3)
    if kind == "cylinder" and random.random() < 0.6:  # lies
        rotation = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    extent = np.ptp(solid_of(kind, size).mesh().used, axis=0)
    friction = random.uniform(0.3, 0.8)
    longest = int(np.argmax(extent))
    offset = np.zeros(3)
    # The heavy end: below where the object stands, at the side of +x where it lies.
    lies = longest < 2 or rotation[2, 2] == 0
    offset[longest] = (1 if lies else -1) * random.uniform(0.15, 0.45) * extent[longest]
    if kind == "sphere":
        offset = np.array([0.0, 0.0, -0.2 * size[0]])
    elif kind == "cone":
        offset *= 0.2
    return Item(
        kind,
        tuple(float(s) for s in size),
        rotation,
        # What a hand can hold at all; a cone slips out of it.
        float(random.uniform(0.2, 0.6) * 2.5 * friction * (0.4 if kind == "cone" else 1)),
        float(friction),
        tuple((rotation @ offset).tolist()),
    )


class Encounter:
    """A gripper before an object on a table; only the simulation knows its mass and balance."""

    def __init__(self, home: Map, gripper: str, item: Item, random: Any) -> None:
        self.home, self.gripper, self._random = home, gripper, random
        self.session = home.connection
        solid = solid_of(item.kind, item.size)
        made = solid.mesh()
        vertices = made.vertices @ item.rotation.T
        self.name = f"{item.kind} {random.integers(1 << 40):x}"
        height = TABLE + GAP - float(vertices[:, 2].min())
        home.add_object(self.name, mesh=Mesh(vertices, made.faces), pose=(0, 0, height))
        standing = np.eye(4)
        standing[2, 3] = height - TABLE
        pose = np.eye(4)
        pose[:3, :3] = item.rotation
        body = body_of(solid, pose=pose, mass=item.mass, friction=item.friction, offset=item.offset)
        self._body, self._standing = body, standing
        self._meet(gripper)

    def _meet(self, gripper: str) -> None:
        self.gripper, self._hand = gripper, stored_gripper(self.session, gripper)
        self._trial = Trial(self._hand, self._body, self._standing)
        self._error = self._look()

    def by(self, gripper: str) -> Encounter:
        """The same object before another gripper."""
        other = copy(self)
        other._meet(gripper)
        return other

    def again(self) -> Encounter:
        """The same object before the same gripper, seen with another error."""
        return self.by(self.gripper)

    def _look(self) -> Floats:
        """The pose that the robot sees, in the frame of the true one."""
        error = np.eye(4)
        error[:2, 3] = self._random.normal(0, POSITION, 2)
        turn = self._random.normal(0, HEADING)
        error[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        return error

    def attempts(self) -> Callable[[Grasp], TrialOutcome]:
        """Return what executes grasps at the pose seen; after the first one, the robot looks again.

        The first grasps of all robots meet the same error.
        """
        errors = chain([self._error], (self._look() for _ in count()))
        return lambda grasp: self._trial.run(grasp, error=next(errors))

    def first(self, *, knowing: bool) -> bool:
        """Whether the best grasp succeeds, with all outcomes or where none is trusted."""
        with self.home.transaction() as transaction:
            if not knowing:
                self.session.execute("UPDATE contributor SET trust = 0")
            found = find_grasps(
                seen_by(self.session), name=self.name, gripper=self.gripper, limit=1
            )
            if not found.rows:
                raise ManipulationError("; ".join(found.problems))
            raise psycopg.Rollback(transaction)
        outcome = self.attempts()(grasp_of_row(found.rows[0], self._hand.opening))
        return mismatch(outcome) is None

    def practise(self, tries: int = 12) -> list[dict[str, Any]]:
        """What `semmap.manipulation.practice.practise` returns."""
        return practise(
            seen_by(self.session), self.name, self.gripper, tries=tries, attempt=self.attempts()
        )


@contextmanager
def encounter_with(
    home: Map, gripper: str, draw_item: Callable[[np.random.Generator], Item], seeds: list[int]
) -> Iterator[Encounter]:
    """A gripper before a random object, which is in the map until the end."""
    random = np.random.default_rng(seeds)
    encounter = Encounter(home, gripper, draw_item(random), random)
    try:
        yield encounter
    finally:
        home[encounter.name].delete()


def compare(encounter: Encounter) -> Meeting | None:
    """First attempts without and with knowledge, none stored; None for an object without grasps."""
    try:
        generate(seen_by(encounter.session), encounter.name, encounter.gripper)
        blind, knowing = (encounter.first(knowing=know) for know in (False, True))
    except ManipulationError:
        return None
    return Meeting(blind, knowing, 0, False, False)


def meet(encounter: Encounter) -> Meeting | None:
    """Let robots without and with knowledge meet an object; None for one without grasps."""
    try:
        generate(seen_by(encounter.session), encounter.name, encounter.gripper)
        blind = encounter.first(knowing=False)
        first = encounter.practise()
        learned = first[-1]["outcome"] == "completed"
        again = learned and encounter.again().practise(tries=1)[0]["outcome"] == "completed"
    except ManipulationError:
        return None
    return Meeting(blind, first[0]["outcome"] == "completed", len(first), learned, again)


def urdf(robot: str) -> Path:
    """The URDF of a robot, from the package example-robot-data."""
    files = importlib.metadata.files("example-robot-data") or []
    return Path(str(next(f.locate() for f in files if str(f).endswith(ROBOTS[robot]))))


def live(
    db: semmap.Database,
    robot: str,
    seed: int,
    objects: int,
    pupil: str | None = None,
    draw_item: Callable[[np.random.Generator], Item] = random_item,
) -> Life:
    """One life of a robot: meetings with random objects, each also with its pupil, if any.

    What the database knew of manipulation before is deleted. Those without a grasp do not count.
    """
    db.session.execute("DELETE FROM object_model")
    name = f"{robot} {seed} {pupil}"
    home = db.create_map(name)
    home.add_object("table", type="table", size=(1.2, 1.2, TABLE), pose=(0, 0, 0))
    for gripper in (robot, pupil):
        if gripper is not None:
            register_gripper(home.connection, urdf(gripper), gripper)
    life = Life([], [], [])
    for number in range(2 * objects):
        with encounter_with(home, robot, draw_item, [seed, 0, number]) as encounter:
            meeting = meet(encounter)
            taught = compare(encounter.by(pupil)) if meeting and pupil else None
        life.own.extend([meeting] if meeting else [])
        life.same.extend([taught] if taught else [])
        if len(life.own) == objects:
            break
    for number in range(2 * NEW if pupil else 0):
        with encounter_with(home, str(pupil), draw_item, [seed, 1, number]) as encounter:
            taught = compare(encounter)
        life.new.extend([taught] if taught else [])
        if len(life.new) == NEW:
            break
    db.drop_map(name)
    return life


# -- statistics -----------------------------------------------------------------------------------


def interval(successes: int, trials: int) -> tuple[float, float, float]:
    """A share and its 95 % confidence interval (Wilson)."""
    z = 1.96
    share = successes / trials
    middle = (share + z**2 / (2 * trials)) / (1 + z**2 / trials)
    half = z / (1 + z**2 / trials) * np.sqrt(share * (1 - share) / trials + z**2 / (4 * trials**2))
    return share, float(middle - half), float(middle + half)


def difference(meetings: list[Meeting]) -> tuple[float, float, float]:
    """How much more first attempts succeed with knowledge, at the same objects; and 95 %."""
    apart = np.array([m.knowing - m.blind for m in meetings], float)
    half = float(1.96 * apart.std(ddof=1) / np.sqrt(len(apart)))
    return float(apart.mean()), float(apart.mean()) - half, float(apart.mean()) + half


def rows_of(robot: str, lives: list[list[Meeting]]) -> list[Row]:
    """The claims on one robot; shapes are known after the first third of a life."""
    meetings = [m for life in lives for m in life]
    taught = "taught" in robot
    late = [m for life in lives for m in life[0 if taught else len(life) // 3 :]]
    knowing = interval(sum(m.knowing for m in late), len(late))
    blind = interval(sum(m.blind for m in late), len(late))
    first = Row(
        f"{robot}: first attempt, known shape",
        _told(knowing),
        f"without knowledge {_told(blind)}",
        f"{len(late)} objects",
        True,
    )
    if taught:
        return [first, difference_row(robot, late)]
    tried = interval(sum(m.learned for m in meetings), len(meetings))
    known = [m.again for m in meetings if m.learned]
    again = interval(sum(known), len(known))
    return [
        first,
        difference_row(robot, late),
        Row(
            f"{robot}: found by trial and error",
            _told(tried),
            "-",
            f"{len(meetings)} objects",
            True,
        ),
        Row(
            f"{robot}: second attempt, same object",
            _told(again),
            f"{len(known)} objects",
            "at least 90 %",
            again[1] >= 0.9,
        ),
    ]


def difference_row(robot: str, meetings: list[Meeting]) -> Row:
    """The claim that knowledge of the shape helps."""
    apart = difference(meetings)
    return Row(f"{robot}: the difference", _told(apart, "+"), "by pairs", "above 0", apart[1] > 0)


def _told(share: tuple[float, float, float], sign: str = "") -> str:
    value, low, high = (100 * v for v in share)
    return f"{value:{sign}.0f} % ({low:{sign}.0f} to {high:{sign}.0f})"


def draw(lives: dict[str, list[list[Meeting]]], path: Path) -> None:
    """Draw the share of first attempts that succeed, over the number of objects known."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.5, 4.2), dpi=150, layout="constrained")
    axes = figure.subplots(1, len(lives), sharey=True, squeeze=False)[0]
    for ax, (robot, runs) in zip(axes, lives.items(), strict=True):
        count = len(runs[0])
        width = 10
        for name, colour, values in (
            ("with knowledge", "#1f6feb", [[m.knowing for m in life] for life in runs]),
            ("without knowledge", "#d1495b", [[m.blind for m in life] for life in runs]),
        ):
            x, shares = [], []
            for begin in range(0, count - width + 1, width):
                chosen = [v for life in values for v in life[begin : begin + width]]
                x.append(begin + (width - 1) / 2)
                shares.append(interval(sum(chosen), len(chosen)))
            share, low, high = np.array(shares).T * 100
            ax.plot(x, share, color=colour, marker="o", ms=3.5, lw=1.8, label=name)
            ax.fill_between(x, low, high, color=colour, alpha=0.15, lw=0)
        again = [m.again for life in runs for m in life if m.learned]
        share, low, high = interval(sum(again), len(again))
        ax.axhspan(100 * low, 100 * high, color="#4c956c", alpha=0.2, lw=0)
        ax.axhline(100 * share, color="#4c956c", lw=1.4, ls="--", label="same object again")
        ax.set_title(f"{robot}, {len(runs)} runs", fontsize=10, loc="left")
        ax.set_xlabel("objects met before", fontsize=9)
        ax.grid(alpha=0.25)
        ax.set_ylim(0, 102)
    axes[0].set_ylabel("first attempts that succeed, %", fontsize=9)
    axes[0].legend(loc="lower right", fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def report(lives: dict[str, list[list[Meeting]]]) -> None:
    """Print the table."""
    rows = [row for name, found in lives.items() for row in rows_of(name, found)]
    for group in ("untaught", *TAUGHT):
        chosen = [
            m
            for name, found in lives.items()
            if name.endswith(group) or (group == "untaught" and "taught" not in name)
            for life in found
            for m in life[len(life) // 3 if group == "untaught" else 0 :]
        ]
        rows.append(difference_row(f"both, {group}", chosen))
    count, objects = (len(v) for v in (lives["panda"], lives["panda"][0]))
    title = f"Grasps learned by trial and error: {count} runs of {objects} objects; 95 % intervals"
    print_rows(title, rows)


# -- runs -----------------------------------------------------------------------------------------


def run(job: tuple[str, int, int, str | None], folder: Path) -> Life:
    """One life in the embedded database of this process."""
    cluster = Cluster(folder / str(os.getpid()))
    with semmap.connect(cluster, migrate=True) as db:
        return live(db, *job)


def main(
    runs: int = RUNS, objects: int = OBJECTS, seed: int = 2000, to: Path | None = None
) -> dict[str, list[list[Meeting]]]:
    """Print the table; draw the curve to a file, if one is given. Return the lives by robot."""
    pupils = {"panda": "pr2", "pr2": "panda"}
    jobs = [(name, seed + i, objects, pupil) for name, pupil in pupils.items() for i in range(runs)]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)  # where root starts it, the server runs as postgres
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(2, context) as pool:
            met = list(pool.map(run, jobs, [Path(folder)] * len(jobs)))
        for home in Path(folder).iterdir():
            Cluster(home).stop()
    lives: dict[str, list[list[Meeting]]] = {}
    for (robot, _, _, pupil), life in zip(jobs, met, strict=True):
        for name, meetings in zip((robot, *(f"{pupil} {t}" for t in TAUGHT)), life, strict=True):
            lives.setdefault(name, []).append(meetings)
    report(lives)
    if to is not None:
        draw({name: found for name, found in lives.items() if name in pupils}, to)
    return lives


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--objects", type=int, default=OBJECTS)
    parser.add_argument("--seed", type=int, default=2000, help="of the first run's objects")
    parser.add_argument("--draw", type=Path)
    given = parser.parse_args()
    main(given.runs, given.objects, given.seed, given.draw)

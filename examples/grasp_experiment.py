"""The paper's experiment (Tosello et al., section IV-D), repeated over many random objects.

    python examples/grasp_experiment.py                  # both grippers, the tables
    python examples/grasp_experiment.py --draw FILE.png  # and the curve

A robot meets one object after another: cuboids, cylinders, spheres and cones of random size, mass,
friction and balance, whose pose it sees with an error. It tries grasps until one succeeds. A robot
without knowledge begins with the best candidate of the generator each time; one with knowledge
begins with the grasp that earlier objects of the same shape let expect a success of. Then it meets
the same object again and takes the grasp that it has stored.
"""

from __future__ import annotations

import argparse
import importlib.metadata
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from semmap.manipulation.candidates import Grasp, grasp_candidates
from semmap.manipulation.collision import Obstacles, free_grasps
from semmap.manipulation.evaluation import Expected, Lesson, learn_grasp
from semmap.manipulation.experience import Experience
from semmap.manipulation.gripper import Gripper, read_gripper
from semmap.manipulation.solids import solid_of
from semmap.manipulation.trial import Outcome, Trial, body_of

Floats = NDArray[np.float64]

ROBOTS = {"panda": "panda_description/urdf/panda.urdf", "pr2": "pr2_description/urdf/pr2.urdf"}

POSITION, HEADING = 0.004, 0.05
"""Standard deviations of a seen pose: metres, radians."""

TABLE = np.array([[[-3.0, -3, 0], [3, -3, 0], [0, 5, 0]]])


class Item(NamedTuple):
    """A random object; its shape as the robot sees it is exact."""

    kind: str
    size: tuple[float, ...]
    pose: Floats
    mass: float
    friction: float
    offset: tuple[float, ...]


class Meeting(NamedTuple):
    """What happened with one object."""

    blind: bool  # the first attempt without knowledge
    knowing: bool  # the first attempt with knowledge of earlier objects
    attempts: int  # until success, with knowledge
    learned: bool
    again: bool  # the stored grasp, at a second meeting


def random_item(random: np.random.Generator) -> Item:
    """Containers: half full, so that their centre of mass lies below the middle and beside it."""
    kind = str(random.choice(["cuboid", "cylinder", "sphere", "cone"]))
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
    pose = np.eye(4)
    if kind == "cylinder" and random.random() < 0.6:  # lies
        pose[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    extent = np.ptp(solid_of(kind, size).mesh().used, axis=0)
    friction = random.uniform(0.3, 0.8)
    longest = int(np.argmax(extent))
    offset = np.zeros(3)
    # The heavy end: below where the object stands, at the side of +x where it lies.
    lies = longest < 2 or pose[2, 2] == 0
    offset[longest] = (1 if lies else -1) * random.uniform(0.15, 0.45) * extent[longest]
    if kind == "sphere":
        offset = np.array([0.0, 0.0, -0.2 * size[0]])
    elif kind == "cone":
        offset *= 0.2
    return Item(
        kind,
        tuple(float(s) for s in size),
        pose,
        # What a hand can hold at all; a cone slips out of it.
        float(random.uniform(0.2, 0.6) * 2.5 * friction * (0.4 if kind == "cone" else 1)),
        float(friction),
        tuple((pose[:3, :3] @ offset).tolist()),
    )


class World:
    """A gripper before an object on a table."""

    def __init__(self, gripper: Gripper, item: Item, random: np.random.Generator) -> None:
        self.item, self._random = item, random
        solid = solid_of(item.kind, item.size)
        triangles = solid.mesh().triangles @ item.pose[:3, :3].T
        self.standing = np.eye(4)
        self.standing[2, 3] = 5e-4 - triangles[..., 2].min()
        body = body_of(
            solid, pose=item.pose, mass=item.mass, friction=item.friction, offset=item.offset
        )
        self._trial = Trial(gripper, body, self.standing)
        grasps = grasp_candidates(item, gripper, friction=0.5)
        seen = triangles + self.standing[:3, 3]
        self.candidates = list(
            grasps[free_grasps(grasps, self.standing, Obstacles(TABLE), item=seen)]
        )

    def attempt(self, grasp: Grasp) -> Outcome:
        """Execute a grasp at the pose that the robot sees."""
        error = np.eye(4)
        error[:2, 3] = self._random.normal(0, POSITION, 2)
        turn = self._random.normal(0, HEADING)
        error[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        return self._trial.run(grasp, error=error)

    def down(self, grasp: Grasp) -> Floats:
        """Gravity in the frame of a grasp."""
        down: Floats = (self.standing @ grasp.pose)[:3, :3].T @ [0.0, 0.0, -1.0]
        return down


def meet(
    gripper: Gripper, item: Item, experience: Experience, random: np.random.Generator
) -> Meeting | None:
    """Let robots without and with knowledge meet an object; None for one without grasps."""
    world = World(gripper, item, random)
    if not world.candidates:
        return None
    expected = Expected()
    blind = expected.mismatch(world.attempt(world.candidates[0])) is None
    lesson: Lesson = learn_grasp(
        experience.ranked(item, gripper.name, world.candidates), world.attempt, world.down
    )
    experience.add(item, gripper.name, lesson)
    knowing = lesson.attempts[0].cause is None
    stored = lesson.learned
    again = stored is not None and expected.mismatch(world.attempt(stored.grasp)) is None
    return Meeting(blind, knowing, len(lesson.attempts), stored is not None, again)


def urdf(robot: str) -> Path:
    """The URDF of a robot, from the package example-robot-data."""
    files = importlib.metadata.files("example-robot-data") or []
    return Path(str(next(f.locate() for f in files if str(f).endswith(ROBOTS[robot]))))


TAUGHT = 40
"""Objects that a teacher meets before."""


def run(robot: str, seed: int, objects: int, teacher: str | None = None) -> list[Meeting]:
    """One life of a robot: meetings with random objects, after those of a teacher, if any."""
    experience = Experience()
    if teacher is not None:
        gripper, random = read_gripper(urdf(teacher)), np.random.default_rng([seed, 1])
        taught = 0
        while taught < TAUGHT:
            taught += meet(gripper, random_item(random), experience, random) is not None
    gripper, random = read_gripper(urdf(robot)), np.random.default_rng(seed)
    meetings: list[Meeting] = []
    while len(meetings) < objects:
        meeting = meet(gripper, random_item(random), experience, random)
        if meeting is not None:
            meetings.append(meeting)
    return meetings


def interval(successes: int, trials: int) -> tuple[float, float, float]:
    """A share and its 95 % confidence interval (Wilson)."""
    z = 1.96
    share = successes / trials
    middle = (share + z**2 / (2 * trials)) / (1 + z**2 / trials)
    half = z / (1 + z**2 / trials) * np.sqrt(share * (1 - share) / trials + z**2 / (4 * trials**2))
    return share, float(middle - half), float(middle + half)


def row(name: str, values: list[bool]) -> str:
    """A row of the table."""
    share, low, high = interval(sum(values), len(values))
    return (
        f"| {name} | {len(values)} | {100 * share:.0f} % | {100 * low:.0f} to {100 * high:.0f} % |"
    )


def difference(meetings: list[Meeting]) -> str:
    """How much more first attempts succeed with knowledge than without, at the same objects."""
    apart = np.array([m.knowing - m.blind for m in meetings], float)
    half = 1.96 * apart.std(ddof=1) / np.sqrt(len(apart))
    low, high = 100 * (apart.mean() - half), 100 * (apart.mean() + half)
    share = f"{100 * apart.mean():+.0f} %"
    return f"| difference, by pairs | {len(apart)} | {share} | {low:+.0f} to {high:+.0f} % |"


def table(robot: str, lives: list[list[Meeting]]) -> list[str]:
    """The shares of successes of one robot."""
    meetings = [m for life in lives for m in life]
    taught = "taught" in robot
    late = [m for life in lives for m in life[0 if taught else len(life) // 2 :]]
    which = "" if taught else " (second half of a run)"
    return [
        f"{robot}: {len(lives)} runs of {len(lives[0])} objects",
        "",
        "| attempt | trials | success | 95 % interval |",
        "|---|---|---|---|",
        row(f"first, with knowledge of the shape{which}", [m.knowing for m in late]),
        row("first, at the same objects, without knowledge", [m.blind for m in late]),
        difference(late),
        row("found by trial and error", [m.learned for m in meetings]),
        row("second, at the same object", [m.again for m in meetings if m.learned]),
        "",
    ]


def draw(lives: dict[str, list[list[Meeting]]], path: Path) -> None:
    """Draw the share of first attempts that succeed, over the number of objects known."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.5, 4.2), dpi=150, layout="constrained")
    axes = figure.subplots(1, len(lives), sharey=True, squeeze=False)[0]
    for ax, (robot, runs) in zip(axes, lives.items(), strict=True):
        count = len(runs[0])
        width = 5
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


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=6)
    parser.add_argument("--objects", type=int, default=60)
    parser.add_argument("--seed", type=int, default=100, help="of the first run's objects")
    parser.add_argument("--draw", type=Path)
    given = parser.parse_args()
    lives: dict[str, list[list[Meeting]]] = {}
    jobs = {"panda": None, "pr2": None, "pr2 taught by panda": "panda"}
    with ProcessPoolExecutor(2) as pool:
        waiting = {
            name: [
                pool.submit(
                    run,
                    name.split()[0],
                    given.seed + i,
                    given.objects // (3 if teacher else 1),
                    teacher,
                )
                for i in range(given.runs)
            ]
            for name, teacher in jobs.items()
        }
        for name, futures in waiting.items():
            lives[name] = [future.result() for future in futures]
            print("\n".join(table(name, lives[name])), flush=True)
    if given.draw is not None:
        draw({name: runs for name, runs in lives.items() if "taught" not in name}, given.draw)


if __name__ == "__main__":
    main()

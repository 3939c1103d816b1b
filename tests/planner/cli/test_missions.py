"""semmap run and semmap missions, on the office."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from planner.mission import MissionError
from tests.command_line import semmap
from tests.manipulation.grippers import BY_HAND
from tests.planner.mission.conftest import World


class Commands:
    def __init__(self, url: str, folder: Path) -> None:
        self.url = url
        self.world = folder / "world"

    def run(self, *arguments: object) -> Result:
        return semmap(self.url, *arguments)

    def simulate(self, *arguments: object) -> Result:
        words = ("--simulate", "--apply", "--speed", 100000, "--world", self.world)
        return self.run("run", *arguments, *words)


@pytest.fixture
def said(world: World, tmp_path: Path) -> Commands:
    return Commands(world.url, tmp_path)


def test_figure_4_is_driven_and_the_muffin_lies_on_desk1(said: Commands, world: World) -> None:
    found = said.simulate("on(muffin, desk1)", "--from", "lab1")
    assert found.exit_code == 0, found.output
    assert "pickup(muffin1, desk4)" in found.output
    assert "place(muffin1, desk1)" in found.output
    assert found.output.rstrip().endswith("done")
    assert world.holder("muffin1") == ("desk1", "on")
    listed = json.loads(said.run("missions", "--json").stdout)
    assert [(m["robot"], m["goal"], m["state"]) for m in listed] == [
        ("robot", "on(muffin, desk1)", "done")
    ]
    shown = said.run("missions", listed[0]["id"]).output
    assert "use_elevator" in shown


def test_without_a_stored_gripper_the_default_one_grasps_places_and_learns(
    said: Commands, world: World
) -> None:
    """`semmap run 'on(muffin, desk1)' --simulate`, and no map changes."""
    words = ("--simulate", "--speed", 100000, "--world", said.world)
    found = said.run("run", "on(muffin, desk1)", *words, "--map", "office")
    assert found.exit_code == 0, found.output
    assert "1 grasp tried in simulation, parallel_gripper is assumed" in found.output
    assert world.holder("muffin1") == ("desk4", "on")
    (copy,) = (name for (name,) in world.ask("SELECT name FROM map") if "simulated" in name)
    listed = said.run("manipulation", "tasks", "--map", copy, "--json")
    tasks = {task["kind"]: task for task in json.loads(listed.stdout)}
    assert {kind: task["outcome"] for kind, task in tasks.items()} == dict.fromkeys(
        ("grasp", "place", "put"), "completed"
    )
    assert {task["contributor"] for task in tasks.values()} == {"simulation"}
    best = json.loads(said.run("grasp", "muffin", "--map", "office", "--json").stdout)[0]
    assert best["action_id"] == tasks["grasp"]["action_id"]
    assert (best["attempts"], best["successes"]) == (0.5, 0.5)
    world.ask(f"SELECT drop_map('{copy}')")


def test_the_muffin_is_grasped_in_simulation_and_the_outcome_stays(
    said: Commands, world: World
) -> None:
    found = said.simulate("on(muffin, desk1)", "--from", "lab1", "--try-grasps")
    assert found.exit_code == 0, found.output
    assert "1 grasp tried in simulation" in found.output
    assert world.holder("muffin1") == ("desk1", "on")
    again = said.simulate("on(muffin, desk4)", "--assume-grasps")
    assert again.exit_code == 0, again.output
    assert "not tried" in again.output
    tasks = json.loads(said.run("manipulation", "tasks", "--json").stdout)
    assert [task["contributor"] for task in tasks] == 3 * ["assumed"] + 3 * ["simulation"]


def test_a_gripper_that_is_too_small_is_the_reason(said: Commands, tmp_path: Path) -> None:
    plates = tmp_path / "plates.urdf"
    plates.write_text(BY_HAND.replace('upper="0.05"', 'upper="0.02"'))
    said.run("manipulation", "add-gripper", plates, "--name", "small")
    found = said.simulate(
        "on(muffin, desk1)", "--from", "lab1", "--try-grasps", "--gripper", "small"
    )
    assert found.exit_code == 1
    assert "gripper small opens 0.04 m" in found.output


@pytest.mark.parametrize("more", [(), ("--try-grasps",)])
def test_an_unknown_gripper_is_refused_before_the_robot_moves(
    said: Commands, world: World, tmp_path: Path, more: tuple[str, ...]
) -> None:
    hand = tmp_path / "hand.urdf"
    hand.write_text(BY_HAND)
    said.run("manipulation", "add-gripper", hand, "--name", "plates")
    missions = world.ask("SELECT id FROM mission ORDER BY 1")
    with pytest.raises(LookupError, match=r"no gripper claw; stored are .*plates.*add-gripper"):
        said.simulate("on(muffin, desk1)", "--from", "lab1", "--gripper", "claw", *more)
    assert world.ask("SELECT id FROM mission ORDER BY 1") == missions


def test_a_reason_as_json(said: Commands, world: World) -> None:
    found = said.simulate("on(muffin, desk1)", "--from", "lab1", "--fail", "door5 locked", "--json")
    assert found.exit_code == 1
    answer: dict[str, Any] = json.loads(found.stdout)
    assert answer["state"] == "failed"
    assert "door5 is locked" in answer["reason"]
    assert {"action": "pass_door", "cause": "locked"}.items() <= answer["steps"][-1].items()
    assert world.ask("SELECT state FROM connector WHERE entity_id = entity_id('door5')") == [
        ("locked",)
    ]


def test_resumed_and_cancelled(said: Commands, world: World) -> None:
    with pytest.raises(MissionError, match="no mission to resume"):
        said.simulate("--resume")
    with world.store("dead") as store:
        number = store.add("robot", "in(muffin, lab2)")
        store.take(number)
        second = store.add("robot", "on(muffin, desk4)")
    with pytest.raises(MissionError, match="is gone"):
        said.simulate("--resume")
    assert said.simulate("on(muffin, desk4)", "--agent", "other", "--from", "lab1").exit_code == 0
    assert said.simulate("--resume").exit_code == 0
    assert said.run("missions", "--cancel", second).exit_code == 0
    states = world.ask("SELECT state FROM mission ORDER BY id")
    assert states == [("done",), ("cancelled",), ("done",)]
    with pytest.raises(MissionError, match="has ended"):
        said.run("missions", "--cancel", number)
    with pytest.raises(MissionError, match="no mission 0"):
        said.run("missions", 0)


@pytest.mark.parametrize(
    "arguments", [("--simulate",), ("on(muffin, desk1)", "--resume", "--simulate")]
)
def test_what_was_not_said(said: Commands, arguments: tuple[str, ...]) -> None:
    found = said.run("run", "on(muffin, desk1)")
    assert found.exit_code == 2
    assert "add --simulate" in " ".join(found.output.split())
    with pytest.raises(ValueError, match="give either a goal, or --resume"):
        said.run("run", *arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("on(muffin, desk1)", "--from", "lab9"), "did you mean lab"),
        (("on(muffin desk1)",), "on takes 2"),
        (("on(muffin, desk1)", "--fail", "grasp"), "is not a failure"),
        (("on(muffin, desk1)", "--agent", "nobody"), "no robot named nobody"),
        (("on(muffin, desk1)", "--agent", "desk1", "--from", "lab1"), "desk1 is of kind object"),
    ],
)
def test_bad_input_changes_nothing(
    said: Commands, world: World, arguments: tuple[str, ...], message: str
) -> None:
    with pytest.raises((ValueError, LookupError), match=message):
        said.simulate(*arguments)
    assert world.ask("SELECT count(*) FROM mission") == [(0,)]
    assert not said.world.exists()


def test_a_run_ends_without_reports_of_leaks(mission_url: str, tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from semmap.cli import main; main()", "--db", mission_url]
    told = subprocess.run(
        [*command, "run", "in(robot, lab1)", "--from", "lab1", "--simulate", "--speed", "500"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert told.returncode == 0, told.stderr
    assert "leaked" not in told.stderr

"""Missions of a robot that Nav2 drives: its answers, and processes that are killed."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import psycopg
import pytest

import semmap
from tests.ros.conftest import ROOT, run, url_of
from tests.waiting import wait_until

HERE = Path(__file__).parent
START = (1.5, 0.5, 0.0)

RUNNERS = """SELECT pg_terminate_backend(pid) FROM pg_locks
WHERE locktype = 'advisory' AND pid <> pg_backend_pid()"""

RunMission = Callable[..., AbstractContextManager[subprocess.Popen[str]]]


@pytest.fixture(scope="module")
def living(small_house: semmap.Map) -> semmap.Map:
    """The small house with a robot that gets between its chairs, and a mug to carry."""
    small_house.add_agent("porter", type="robot", pose=START)
    small_house.add_object("mug", type="mug", size=(0.08, 0.08, 0.1), on="CoffeeTable_01_001")
    return small_house


@pytest.fixture
def nav2(ros_python: str, ros_environment: dict[str, str], tmp_path: Path) -> Iterator[Path]:
    """The file that says how the simulator serves."""
    file = tmp_path / "mode"
    file.write_text("drive")
    words = [ros_python, str(HERE / "nav2.py"), *map(str, START), str(file)]
    with run(words, ros_environment) as process:
        yield file
        assert process.stdin is not None
        process.stdin.close()
        process.wait(20)


@pytest.fixture
def run_mission(
    ros_python: str, ros_environment: dict[str, str], living: semmap.Map, tmp_path: Path
) -> RunMission:
    """Run the command: its words, and further parameters."""
    environment = ros_environment | {"PORTER": str(tmp_path / "gripper.json")}
    environment["PYTHONPATH"] += f":{HERE}:{tmp_path}"

    @contextmanager
    def mission(*words: str, **parameters: Any) -> Iterator[subprocess.Popen[str]]:
        file = tmp_path / "params.yaml"
        values = {"url": url_of(living), "map": "house", "agent": "porter", "patience": 30.0}
        values["behaviours"] = "porter.Porter"
        file.write_text(json.dumps({"/semmap_mission": {"ros__parameters": values | parameters}}))
        ros = ["--ros-args", "--params-file", str(file)]
        with run([ros_python, "-m", "semmap_ros.mission", *words, *ros], environment) as process:
            yield process

    return mission


@pytest.fixture
def halted(run_mission: RunMission, nav2: Path, living: semmap.Map) -> RunMission:
    """Run a mission from home to the kitchen, and go on when a step is as Nav2 lets it be."""

    @contextmanager
    def mission(mode: str = "freeze", state: str = "started") -> Iterator[subprocess.Popen[str]]:
        living["porter"].move_to(*START)
        nav2.write_text(mode)
        with run_mission("in(robot, kitchen)") as process:
            wait_until(lambda: has_step(living, state))
            yield process

    return mission


def end_of(process: subprocess.Popen[str]) -> tuple[int, str]:
    """The status of a mission's process, and its last line."""
    said, _ = process.communicate(timeout=120)
    return process.returncode, said.strip()


def test_a_delivery_ends_done(run_mission: RunMission, nav2: Path, living: semmap.Map) -> None:
    with run_mission("on(mug, KitchenTable_01_001)") as process:
        status, said = end_of(process)
    assert (status, said.split()[-1]) == (0, "done"), said
    assert living["mug"].holder == living["KitchenTable_01_001"]
    assert living["porter"].room == living["kitchen"]


@pytest.mark.parametrize(
    ("mode", "why"),
    [
        ("abort", "Nav2 gave up: a cat is in the way"),
        ("refuse", "Nav2 refused the goal"),
        ("freeze", "Nav2 sent nothing for 8 s"),
    ],
)
def test_a_mission_fails_with_the_reason_of_nav2(
    run_mission: RunMission, nav2: Path, living: semmap.Map, mode: str, why: str
) -> None:
    living["porter"].move_to(*START)
    nav2.write_text(mode)
    with run_mission("in(robot, kitchen)", patience=8.0 if mode == "freeze" else 30.0) as process:
        status, said = end_of(process)
    assert status == 1
    assert "failed" in said
    assert why in said
    assert living["porter"].room == living["living-room"]


def test_a_mission_goes_on_where_nav2_gave_up_once(
    halted: RunMission, nav2: Path, living: semmap.Map
) -> None:
    with halted("abort", "failed") as process:
        nav2.write_text("drive")
        assert end_of(process)[0] == 0
    assert "failed" in states(living)
    assert living["porter"].room == living["kitchen"]


def test_without_nav2_it_ends_and_leaves_no_mission(
    run_mission: RunMission, living: semmap.Map
) -> None:
    before = len(living.missions())
    with run_mission("in(robot, balcony)", patience=2.0) as process:
        status, _ = end_of(process)
    assert status == 1
    assert len(living.missions()) == before


def test_a_cancelled_mission_stops_the_drive(halted: RunMission, living: semmap.Map) -> None:
    with halted() as process:
        living.cancel_mission(living.missions()[0]["id"])
        assert end_of(process)[1].split()[-1] == "cancelled"


def test_a_killed_mission_is_resumed(
    halted: RunMission, run_mission: RunMission, nav2: Path, living: semmap.Map
) -> None:
    with halted() as process:
        process.kill()
    nav2.write_text("drive")
    number = living.missions()[0]["id"]
    with run_mission("--resume", str(number)) as process:
        status, said = end_of(process)
    assert (status, said) == (0, f"mission {number}: done")
    assert living["porter"].room == living["kitchen"]


def test_a_mission_that_runs_is_not_resumed(
    halted: RunMission, run_mission: RunMission, nav2: Path, living: semmap.Map
) -> None:
    with halted() as process:
        with run_mission("--resume", str(living.missions()[0]["id"])) as other:
            assert end_of(other)[0] == 1
        nav2.write_text("drive")
        status, said = end_of(process)
    assert (status, said.split()[-1]) == (0, "done"), said


def test_a_mission_outlives_killed_sessions_of_its_database(
    halted: RunMission, nav2: Path, living: semmap.Map
) -> None:
    with halted() as process:
        with psycopg.connect(url_of(living), autocommit=True) as session:
            ended = session.execute(RUNNERS).fetchall()
        assert ended
        nav2.write_text("drive")
        status, said = end_of(process)
    assert (status, said.split()[-1]) == (0, "done"), said
    assert living["porter"].room == living["kitchen"]


def test_the_robot_of_the_page_picks_up_what_its_command_names(
    run_mission: RunMission, nav2: Path, living: semmap.Map, tmp_path: Path
) -> None:
    page = (ROOT / "docs/ros.md").read_text()
    (example,) = re.findall(r"```py\n(.*?)```", page, re.DOTALL)
    (goal, behaviours) = re.findall(r"mission '(.*)' .* behaviours:=(\S+)", page)[0]
    module, _, name = behaviours.partition(".")
    (tmp_path / f"page_{module}.py").write_text(example)
    living["porter"].move_to(*START)
    with run_mission(goal, behaviours=f"page_{module}.{name}") as process:
        status, said = end_of(process)
    assert (status, said.split()[-1]) == (0, "done"), said
    assert living["mug"].holder == living["porter"]


def states(map: semmap.Map) -> list[str]:
    """The states of the steps of the newest mission."""
    return [step["state"] for step in map.mission_steps(map.missions()[0]["id"])]


def has_step(map: semmap.Map, state: str) -> bool:
    """Whether the newest mission runs, and a step of it is in a state."""
    newest = map.missions()[:1]
    return bool(newest) and newest[0]["state"] == "running" and state in states(map)

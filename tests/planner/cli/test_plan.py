import json

import pytest

from planner.tasks import NoPlanError
from tests.command_line import semmap
from tests.planner.tasks.test_domain_file import TIDY
from tests.planner.tasks.test_solver import FIGURE_4


@pytest.fixture
def plan(office_url):
    return lambda *said: semmap(office_url, "plan", *said).stdout


def test_figure_4_comes_out_of_the_office_step_by_step(plan):
    said = json.loads(plan("on(muffin, desk1)", "--from", "lab1", "--json"))
    actions = [
        f"{a['name']}({', '.join(a['arguments'])})" if a["arguments"] else a["name"]
        for a in said["actions"]
    ]
    assert "\n".join(actions) == FIGURE_4
    assert said["optimal"]
    assert said["actions"][8]["entities"] == ["muffin1", "desk4"]
    assert sum(a["seconds"] for a in said["actions"]) == pytest.approx(said["seconds"])


def test_as_a_table_and_from_home(plan):
    said = plan("on(muffin, desk1)")
    assert "12  place(muffin, desk1)" in said
    assert "(no plan is shorter)" in said


def test_reasons_and_actions_of_ones_own(plan, tmp_path):
    with pytest.raises(NoPlanError, match="desk8 cannot be reached: door13 is locked"):
        plan("on(muffin, desk8)")
    said = plan("wiped(desk2)", "--domain", TIDY, "--pddl", tmp_path)
    assert "wipe(desk2)" in said
    assert {p.name for p in tmp_path.iterdir()} == {"domain.pddl", "problem.pddl"}


def test_a_plan_without_a_bound_says_so(plan):
    said = plan("found(muffin1)", "--from", "lab1")
    assert "(it is not known how much shorter a plan may be)" in said
    assert "inf" not in said

import pytest

from planner.tasks.goal import Atom, GoalError, Word, parse_goal


@pytest.mark.parametrize(
    "text",
    [
        "on(muffin, desk1) and in(robot, kitchen)",
        "on(a muffin,desk1),in(robot,the kitchen)",
        " on ( muffin , 'desk1' ) , and in(robot, kitchen) ",
    ],
)
def test_conjunctions_articles_and_quotes(text):
    assert parse_goal(text).atoms == (
        Atom("on", (Word("muffin"), Word("desk1"))),
        Atom("in", (Word("robot"), Word("kitchen"))),
    )


def test_another_is_a_second_one():
    goal = parse_goal("on(a muffin, desk1) and on(another muffin, desk1)")
    assert goal.words() == [Word("muffin"), Word("desk1"), Word("muffin", 1)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the goal is empty"),
        ("on(muffin)", r"has 1 arguments; on takes 2"),
        ("onn(muffin, desk1)", "no relation onn; did you mean on"),
        ("on(muffin, desk1", "character 17, where the end is"),
        ("on muffin", r"\( after on is expected at character 4"),
        ("on(muffin, desk1) in(robot, lab1)", None),
        ("on(muffin, 'desk1)", "close the quotes"),
        ("on(m, desk1), on(m, desk2)", "contradict each other: m is in one place only"),
        ("on(m, m)", "m cannot be on itself"),
        ("on(a1, b), on(b, a1)", "in a circle"),
        ("in(robot, lab1) and in(robot, lab2)", "robot is in one place only"),
        ("carries(robot, m) and on(m, desk1)", "contradict"),
        ("on(robot, desk1)", "no object can be on or under a robot"),
        ("in(m, robot)", "use carries"),
        ("carries(m, robot)", "only the robot carries"),
    ],
)
def test_what_cannot_be_meant_is_refused(text, message):
    if message is None:
        assert len(parse_goal(text).atoms) == 2
        return
    with pytest.raises(GoalError, match=message):
        parse_goal(text)

"""Stored actions: whose they are, which come first, what outcomes change, and what is refused."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rdflib import OWL, RDF, SKOS, Graph, Namespace, URIRef
from sqlalchemy import select
from sqlalchemy.orm import Session

from semmap import Map
from semmap.database.files import schema_folder
from semmap.geometry.pose import Pose
from semmap.manipulation.action_record import ActionRecord, action_key
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.reader import (
    actions_by_shape,
    actions_on,
    entities_meant,
    function_named,
)
from semmap.manipulation.store.actions import add_actions, add_put
from semmap.manipulation.store.database_answers import refusals
from semmap.manipulation.store.devices import add_automaton, add_device, add_path
from semmap.manipulation.store.models import add_object, object_model_id, set_shape
from semmap.manipulation.store.tasks import add_task, record_task
from semmap.model import ManipulationTask, ObjectModel, StoredAction
from semmap.snake_case import snake_case
from tests.manipulation.cup_map import candidate, path_between, primitive
from tests.seen import seen_by

PUSH = ActionRecord("push", Pose(z=0.02), motion=(0.1, 0.0, 0.0), approach="side")
TURN = ActionRecord("turn", Pose(x=0.1), motion=(0, 0, 0, 0, 0, 1, 0.5))
OPEN = ActionRecord("open", Pose(x=0.9), motion=(0, 0, 0, 0, 0, 1, 1.57))
PLACE = ActionRecord("place", Pose(z=0.05), post_pose=Pose(z=0.15))


def session(cups: Map) -> Any:
    return cups.connection


def ids(rows: list[dict[str, Any]]) -> list[int]:
    return [row["action_id"] for row in rows]


def count(cups: Map, table: str) -> int:
    return int(session(cups).execute(f"SELECT count(*) FROM {table}").fetchone()[0])


# -- retrieval ------------------------------------------------------------------------------------


def test_the_queries_of_the_paper(cups: Map) -> None:
    """Section III: a cup, something suitable for drinking, the object at a pose."""
    here = session(cups)
    low, high = add_actions(
        here, "cup1", None, [candidate(quality=0.2), candidate(yaw=1.0, quality=0.9)]
    )
    (bottle,) = add_actions(here, "bottle", None, [candidate(quality=0.6)])
    add_actions(here, "book", None, [candidate(quality=1.0)])
    assert ids(actions_on(seen_by(here), name="cup")) == [high, high, low, low]
    assert {row["entity"] for row in actions_on(seen_by(here), name="cup")} == {"cup1", "cup2"}
    assert ids(actions_on(seen_by(here), name="cup2")) == [
        high,
        low,
    ]  # stored for cup1: of one model
    assert ids(actions_on(seen_by(here), function="drinking")) == [high, high, bottle, low, low]
    assert ids(actions_on(seen_by(here), function="drink", limit=1)) == [high]
    assert ids(actions_on(seen_by(here), point=(1.5, 1.6, 0.8))) == [bottle]
    assert ids(actions_on(seen_by(here), point=(1.55, 1.6, 0.8))) == [bottle]  # 15 mm beside it
    assert actions_on(seen_by(here), name="cup", gripper="wide") == []
    assert actions_on(seen_by(here), name="cup", kind="push") == []


def test_poses_are_in_the_frame_of_the_map(cups: Map) -> None:
    here = session(cups)
    add_actions(here, "cup1", None, [candidate(x=0.02, yaw=0.4)])
    world = dict(here.execute("SELECT e.name, pose FROM world JOIN entity e ON e.id = entity_id"))
    for row in actions_on(seen_by(here), name="cup"):
        outer = Pose(*world[row["entity"]]).matrix
        assert row["pose"].matrix == pytest.approx(outer @ candidate(x=0.02, yaw=0.4).pose)
        assert row["pre_pose"].matrix == pytest.approx(outer @ candidate(x=0.02, yaw=0.4).pre_grasp)
        assert row["model_pose"].matrix == pytest.approx(candidate(x=0.02, yaw=0.4).pose)


def test_actions_of_a_similar_shape_serve_an_unknown_object(cups: Map) -> None:
    here = session(cups)
    tilted = Pose.from_rpy(0.1, 0.2, 0.3, 0.5, 0.4, 0.3).matrix
    for name, radius in (("thin", 0.03), ("thick", 0.06)):
        id_ = add_object(
            here, f"shape:{name}", primitive=primitive("cylinder", radius, 0.1, pose=tilted)
        )
        add_actions(here, id_, None, [candidate(x=radius)])
    assert len(actions_by_shape(here, "cylinder", (0.045, 0.1), tolerance=0.02)) == 2
    assert actions_by_shape(here, "cylinder", (0.032, 0.12), tolerance=0.01) == []
    assert actions_by_shape(here, "cone", (0.03, 0.1)) == []
    (row,) = actions_by_shape(here, "cylinder", (0.032, 0.105))
    assert row["difference"] == pytest.approx(0.005)
    assert tilted @ row["pose"].matrix == pytest.approx(candidate(x=0.03).pose)
    with pytest.raises(ManipulationError, match="is not a shape"):
        actions_by_shape(here, "cylinder", (0.03,))


def test_functions_are_those_of_the_type_its_supertypes_and_the_model(cups: Map) -> None:
    here = session(cups)
    names = {row[0]: row[1] for row in here.execute("SELECT id, name FROM entity").fetchall()}

    def meant(word: str) -> set[str]:
        return {names[id_] for id_ in entities_meant(seen_by(here), function=word)}

    assert meant("drinking") == {"cup1", "cup2", "bottle"}
    assert meant("reading") == {"book"}
    here.execute(
        "UPDATE object_model SET functions = '{pouring}' WHERE id = %s",
        (object_model_id(here, "cup1"),),
    )
    assert meant("pouring") == {"cup1", "cup2", "bottle"}
    assert function_named(here, "drink") == "drinking"
    with pytest.raises(LookupError, match="did you mean drinking"):
        function_named(here, "drinkin' tea")
    with pytest.raises(LookupError, match="no type and no object model"):
        entities_meant(seen_by(here), function="flying")


def test_knowledge_of_models_that_the_map_lacks(cups: Map) -> None:
    here = session(cups)
    glass = add_object(here, "other:glass", type="wine_glass")
    (stored,) = add_actions(here, glass, None, [candidate(quality=0.95)])
    add_actions(here, "cup1", None, [candidate(quality=0.5)])
    known = here.execute("SELECT action_id FROM known_actions('drinking', most => 1)").fetchall()
    assert known == [(stored,)]
    assert stored not in ids(actions_on(seen_by(here), function="drinking"))


@pytest.mark.parametrize("best", [0.2, 1.0])
def test_the_best_of_many_objects_are_those_of_a_full_sort(cups: Map, best: float) -> None:
    """Among the best 2,000 of the gripper (1.0), and where none of them is on the objects (0.2)."""
    here = session(cups)
    here.execute("SELECT setseed(0.5)")
    here.execute(
        "INSERT INTO object_model (key) SELECT 'many:' || i FROM generate_series(1, 400) i"
    )
    here.execute(
        "INSERT INTO action (kind, object_id, gripper_id, pose, quality) SELECT 'grasp', o.id, "
        "gripper_named('two_fingers'), '{0,0,0,0,0,0,1}', CASE WHEN o.id %% 2 = 0 "
        "THEN round((%s * random())::numeric, 2) ELSE 0.5 + random() / 2 END "
        "FROM object_model o, generate_series(1, 15) n",
        (best,),
    )
    here.execute("UPDATE action SET replaced_by = id + 1 WHERE id %% 7 = 0".replace("%%", "%"))
    for most in (1, 10, 37):
        expected = here.execute(
            "SELECT a.id, a.object_id, a.expected FROM action a WHERE a.object_id %% 2 = 0 "
            "AND a.replaced_by IS NULL ORDER BY a.expected DESC, a.id LIMIT %s",
            (most,),
        ).fetchall()
        found = here.execute(
            "SELECT * FROM best_actions(ARRAY(SELECT id FROM object_model WHERE id %% 2 = 0), "
            "gripper_named('two_fingers'), 'grasp', %s)",
            (most,),
        ).fetchall()
        assert found == expected


# -- outcomes -------------------------------------------------------------------------------------


def test_outcomes_decide_which_action_comes_first(cups: Map) -> None:
    here = session(cups)
    a, b = add_actions(here, "cup1", None, [candidate(quality=0.8), candidate(x=0.01, quality=0.6)])
    record_task(here, "cup1", action=a, outcome="error", message="slipped")
    record_task(here, "cup2", action=b, outcome="completed", robot="robot", goal=Pose(x=1))
    rows = actions_on(seen_by(here), name="cup1")
    assert ids(rows) == [b, a]
    assert [row["expected"] for row in rows] == pytest.approx([2.2 / 3, 1.6 / 3])
    task = here.execute("SELECT start, goal FROM task WHERE action_id = %s", (b,)).fetchone()
    assert task == ([1.9, 1.5, 0.75, *task[0][3:]], Pose(x=1).row)


def test_what_worked_replaces_what_did_not(cups: Map) -> None:
    here = session(cups)
    (failed,) = add_actions(here, "cup1", None, [candidate(quality=0.9)])
    record_task(here, "cup1", action=failed, outcome="error")
    (worked,) = add_actions(here, "cup1", None, [candidate(x=0.004, quality=0.5)])
    record_task(here, "cup1", action=worked, outcome="completed", instead_of=failed)
    assert ids(actions_on(seen_by(here), name="cup")) == [worked, worked]
    cup = object_model_id(here, "cup1")
    tried = here.execute(
        "SELECT approach, sum(attempts), sum(successes) FROM action "
        "WHERE object_id = %s AND kind = 'grasp' AND attempts > 0 GROUP BY 1",
        (cup,),
    ).fetchall()
    assert tried == [("side", 2.0, 1.0)]
    (other,) = add_actions(here, "book", None, [candidate()])
    with pytest.raises(ManipulationError, match="not of the same kind"):
        record_task(here, "book", action=other, outcome="completed", instead_of=worked)
    assert count(cups, "task") == 2


def test_simulated_outcomes_count_by_their_trust(cups: Map) -> None:
    here = session(cups)
    (id_,) = add_actions(here, "cup1", None, [candidate(quality=0.5)])
    record_task(here, "cup1", action=id_, outcome="completed", simulated=True)
    assert actions_on(seen_by(here), name="cup1")[0]["attempts"] == 0.5
    here.execute("UPDATE contributor SET trust = 1 WHERE name = 'simulation'")
    assert actions_on(seen_by(here), name="cup1")[0]["attempts"] == 1


def test_a_task_counts_once_when_it_ends(cups: Map) -> None:
    here = session(cups)
    (id_,) = add_actions(here, "cup1", None, [candidate()])
    task = add_task(here, "cup1", action=id_, deadline=datetime(2030, 1, 1, tzinfo=UTC))

    def end(outcome: str) -> None:
        here.execute("UPDATE task SET outcome = %s WHERE id = %s", (outcome, task))

    end("running")
    assert actions_on(seen_by(here), name="cup1")[0]["attempts"] == 0
    end("completed")
    end("completed")
    assert actions_on(seen_by(here), name="cup1")[0]["successes"] == 1
    with pytest.raises(ManipulationError, match="has ended"), here.transaction(), refusals():
        end("error")


def test_a_put_is_a_grasp_then_a_place(cups: Map) -> None:
    here = session(cups)
    (grasp,) = add_actions(here, "cup1", None, [candidate()])
    place, push = add_actions(here, "cup1", None, [PLACE, PUSH])
    whole = add_put(here, grasp, place)
    record_task(here, "cup1", "put", action=whole, outcome="completed")
    tried = dict(here.execute("SELECT id, successes FROM action").fetchall())
    assert tried == {grasp: 1, place: 1, push: 0, whole: 1}
    with pytest.raises(ManipulationError, match="is a push: a put is a grasp"):
        add_put(here, grasp, push)


@pytest.mark.parametrize("record", [PUSH, TURN, OPEN, PLACE])
def test_all_kinds_are_stored_and_found(cups: Map, record: ActionRecord) -> None:
    here = session(cups)
    stored = add_actions(here, "book", "wide", [record])
    (row,) = actions_on(seen_by(here), name="book", gripper="wide", kind=record.kind)
    assert [row["action_id"]] == stored
    assert row["motion"] == (list(record.motion) if record.motion else None)


# -- whose, and where -----------------------------------------------------------------------------


def test_equal_actions_are_stored_once(cups: Map) -> None:
    here = session(cups)
    first = add_actions(here, "cup1", None, [candidate(), candidate(yaw=1)])
    turned = candidate()
    turned.pose = Pose(*turned_row(Pose.from_matrix(turned.pose)))  # -q is the same rotation
    assert add_actions(here, "cup2", None, [candidate(yaw=1), turned]) == first[::-1]
    assert count(cups, "object_model") == 1
    assert add_actions(here, "cup2", "wide", [candidate()]) != first[:1]


def turned_row(pose: Pose) -> list[float]:
    return [*pose[:3], *(-q for q in pose[3:])]


def test_a_grasp_shown_in_another_frame_is_stored_in_that_of_the_model(
    cups: Map,
) -> None:
    here = session(cups)
    shown = candidate(x=1.9, pose=Pose.planar(1.9, 1.4, 0.3, z=0.8).matrix, pre_grasp=None)
    add_actions(here, "cup2", None, [shown], frame="map")
    (row,) = actions_on(seen_by(here), name="cup2")
    assert row["pose"].matrix == pytest.approx(shown.pose)
    seen = candidate(pose=Pose.planar(0.4, 0, z=0.05).matrix, pre_grasp=None)
    add_actions(here, "cup2", "wide", [seen], frame="table")
    (row,) = actions_on(seen_by(here), name="cup2", gripper="wide")
    table = here.execute("SELECT pose FROM world WHERE entity_id = entity_id('table')").fetchone()
    assert row["pose"].matrix == pytest.approx(Pose(*table[0]).matrix @ seen.pose)
    turned = ActionRecord("turn", Pose(), motion=(2, 0, 0, 1, 0, 0, 0.5)).moved(
        Pose.planar(1, 0, np.pi / 2)
    )
    assert turned.motion == pytest.approx((1, 2, 0, 0, 1, 0, 0.5))


def test_a_path_is_reused_until_something_moves_into_its_way(cups: Map) -> None:
    here = session(cups)
    add_device(here, "arm", "robot", joints={"elbow": (-1.0, 2.0)})
    add_automaton(here, "arm with fingers", "arm", "two_fingers")
    way = [Pose.planar(x, 2.5, 0.1) for x in (0.5, 1.0, 2.0, 3.0)]
    add_path(here, "arm with fingers", way)

    def found(start: Pose = way[0], goal: Pose = way[-1]) -> list[Pose] | None:
        return path_between(here, "arm with fingers", start, goal)

    assert found() == way
    assert found(Pose.planar(0.505, 2.5, 0.1)) == way
    assert found(Pose.planar(0.6, 2.5, 0.1)) is None
    assert found(Pose.planar(0.5, 2.5, 0.3)) is None
    assert found(way[-1], way[0]) is None
    here.execute("SELECT move_to(entity_id('book'), 1, 1.2, 0)")
    assert found() == way
    here.execute("SELECT move_to(entity_id('book'), 1.5, 2.65, 0)")
    assert found() is None


def test_capabilities_of_an_automaton_and_what_actions_require(cups: Map) -> None:
    here = session(cups)
    add_device(here, "base", "robot", capabilities=[])
    add_device(here, "arm", "robot")
    add_automaton(here, "able", "arm", "wide")
    add_automaton(here, "handless", "arm")
    add_automaton(here, "armless", "base", "wide")
    missing = {
        name: here.execute("SELECT missing_capabilities(%s, 'grasp')", (name,)).fetchone()[0]
        for name in ("able", "handless", "armless")
    }
    assert missing == {"able": [], "handless": ["gripping"], "armless": ["reaching"]}


def test_the_orm_has_the_rows(cup_map: Map) -> None:
    here = session(cup_map)
    (id_,) = add_actions(here, "cup1", None, [candidate()])
    try:
        with Session(cup_map.database.engine) as orm:
            action = orm.scalars(select(StoredAction).where(StoredAction.id == id_)).one()
            assert action.object.key.startswith("mesh:")
            assert action.gripper.device.name == "two_fingers"
            assert action.pose.matrix == pytest.approx(candidate().pose)
            assert orm.scalars(select(ObjectModel)).one() is action.object
            assert action.posture == {"finger": 0.03}
    finally:
        here.execute("DELETE FROM object_model")


def test_the_orm_has_composed_actions_pushes_doors_and_deadlines(
    cup_map: Map,
) -> None:
    """As one session of it reads them: put = grasp, then place; a rotational push; a door."""
    here = session(cup_map)
    deadline = datetime(2030, 1, 1, tzinfo=UTC)
    (grasp,) = add_actions(here, "cup1", None, [candidate()])
    place, push, turn, door = add_actions(here, "cup1", None, [PLACE, PUSH, TURN, OPEN])
    whole = add_put(here, grasp, place)
    steps = "SELECT step_id FROM action_step WHERE whole_id = %s ORDER BY number"
    assert here.execute(steps, (whole,)).fetchall() == [(grasp,), (place,)]
    goal = Pose(x=1.0, y=1.2, z=0.75)
    task = add_task(here, "cup1", "put", action=whole, robot="robot", goal=goal, deadline=deadline)
    try:
        with Session(cup_map.database.engine) as orm:
            put = orm.get_one(StoredAction, whole)
            assert put.pose is None
            kinds = {push: (PUSH, "push"), turn: (TURN, "turn"), door: (OPEN, "open")}
            for id_, (record, kind) in kinds.items():
                stored = orm.get_one(StoredAction, id_)
                assert (stored.kind, stored.motion) == (kind, list(record.motion))
            ordered = orm.get_one(ManipulationTask, task)
            assert (ordered.deadline, ordered.outcome) == (deadline, "to run")
            assert ordered.action is put
            assert ordered.entity.name == "cup1"
            assert ordered.goal == pytest.approx(goal)
    finally:
        for table in ("task", "object_model"):
            here.execute(f"DELETE FROM {table}")


# -- refusals -------------------------------------------------------------------------------------

REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "a pose that is not rigid": (
        {"pose": np.diag([1, 1, 2, 1.0])},
        "grasp 2: pose: is not a rigid",
    ),
    "a pose of NaN": ({"pose": np.full((4, 4), np.nan)}, "grasp 2: pose: is not a pose"),
    "a mirrored pose": ({"pose": np.diag([1, 1, -1, 1.0])}, "is not a rigid transform"),
    "three numbers": ({"pose": (1, 2, 3)}, "is not a pose"),
    "a quality above 1": ({"quality": 1.5}, "grasp 2: quality is 1.5"),
    "a negative width": ({"width": -0.1}, "grasp 2: width is -0.1"),
    "wider than the gripper": ({"width": 0.1}, "gripper two_fingers opens 0.09 m"),
    "a joint at infinity": ({"posture": {"finger": np.inf}}, "joint finger is at inf"),
    "an unknown kind": ({"kind": "kick"}, "kind is 'kick'"),
    "a push without a motion": ({"kind": "push"}, "motion has 0 numbers: a push has 3"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_bad_action_is_refused_and_nothing_is_stored(cups: Map, name: str) -> None:
    values, text = REFUSED[name]
    with pytest.raises(ManipulationError, match=text):
        add_actions(session(cups), "cup1", None, [candidate(), candidate(**values)])
    assert count(cups, "action") == count(cups, "object_model") == 0


@pytest.mark.parametrize(
    ("model", "gripper", "frame", "text"),
    [
        ("cup1", None, "base_lnik", "no frame base_lnik"),
        ("cup1", None, "tabel", "no frame tabel; did you mean table"),
        ("cup3", None, "model", "no entity cup3; did you mean cup"),
        ("cup1", "two_finger", "model", "no gripper two_finger; did you mean two_fingers"),
        (99, None, "model", "no object model 99"),
        ("note", None, "model", "note: has no mesh"),
        ("note", None, "map", "need an entity that has a pose, not note"),
    ],
)
def test_unknown_names_and_frames_are_refused(
    cups: Map, model: str | int, gripper: str | None, frame: str, text: str
) -> None:
    with pytest.raises((LookupError, ManipulationError), match=text):
        add_actions(session(cups), model, gripper, [candidate()], frame=frame)
    assert count(cups, "action") == count(cups, "object_model") == 0


def test_questions_without_an_answer_are_errors(cups: Map) -> None:
    here = session(cups)
    for query, text in (
        ({"name": "cuup"}, "did you mean cup"),
        ({"point": (3, 2.9, 2)}, "no object with geometry within"),
        ({"point": (1, 2)}, "x, y, z"),
        ({"name": "cup", "gripper": "pr3"}, "no gripper pr3"),
        ({"name": "cup", "kind": "kick"}, "kick is not one of"),
        ({}, "one of a name, a function and a point"),
    ):
        with pytest.raises((LookupError, ManipulationError), match=text), here.transaction():
            actions_on(seen_by(here), **query)


def test_a_shape_without_a_size_is_refused(cups: Map) -> None:
    here = session(cups)
    set_shape(here, "cup1", primitive("cylinder", 0.035, 0.09))
    for bad in (primitive("sphere", 0.1, 0.2), primitive("blob", 0.1), primitive("sphere", -1.0)):
        with pytest.raises(ManipulationError):
            set_shape(here, "cup1", bad)


# -- the ontology ---------------------------------------------------------------------------------


def knowledge_ontology() -> Graph:
    return Graph().parse(schema_folder() / "ontology" / "knowledge" / "manipulation.ttl")


def test_the_database_requires_the_capabilities_of_the_ontology(cups: Map) -> None:
    own = Namespace("urn:semmap:ontology#")
    graph = knowledge_ontology()
    for kind in ("grasp", "place", "push", "turn", "open", "put"):
        found = {
            snake_case(str(c).split("#")[1])
            for above in graph.transitive_objects(
                own[kind.capitalize()], URIRef("http://www.w3.org/2000/01/rdf-schema#subClassOf")
            )
            for c in graph.objects(above, own.requires)
        }
        row = session(cups).execute("SELECT required_capabilities(%s)", (kind,)).fetchone()
        assert set(row[0]) == found, kind


def test_the_alignment_names_classes_that_cora_has(worlds: Path) -> None:
    standard = Graph()
    for name in ("cora", "corax", "rparts", "pos"):
        standard.parse(worlds / "ontologies" / f"{name}.owl")
    known = {*standard.subjects(), *standard.objects()}
    graph = knowledge_ontology()
    matches = [
        o
        for p in (SKOS.closeMatch, SKOS.broadMatch, SKOS.relatedMatch)
        for o in graph.objects(None, p)
    ]
    assert len(matches) >= 8
    assert [str(m) for m in matches if m not in known] == []
    assert len(set(graph.subjects(RDF.type, OWL.Class))) >= 20


def test_keys_do_not_depend_on_the_order_of_joints_or_the_sign_of_a_quaternion() -> None:
    a = ActionRecord("grasp", Pose(qx=0.6, qw=0.8), posture={"a": 1.0, "b": 2.0})
    b = ActionRecord("grasp", Pose(qx=-0.6, qw=-0.8), posture={"b": 2.0, "a": 1.0})
    assert action_key(a, "mesh:1", "g") == action_key(b, "mesh:1", "g")
    assert action_key(a, "mesh:1", "g") != action_key(a, "mesh:2", "g")
    assert len({action_key(a, "m", g) for g in "gh"}) == 2

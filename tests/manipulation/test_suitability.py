"""What the ontology excludes, beside owlrl, and in retrieval."""

from __future__ import annotations

import warnings
from itertools import product

import owlrl
import pytest
import rdflib

from semmap import Map
from semmap.database.files import schema_folder
from semmap.knowledge.manipulation_triples import MANIPULATION_TRIPLES
from semmap.knowledge.vocabulary import SEMMAP
from semmap.knowledge.whole_graph import facts_of
from semmap.manipulation.candidates import grasp_candidates
from semmap.manipulation.pushes import find_pushes
from semmap.manipulation.retrieval import (
    DEFAULT_GRIPPER,
    find_grasps,
    known_grasps,
    register_gripper,
    stored_gripper,
)
from semmap.manipulation.solids import solid_of
from semmap.manipulation.store.actions import add_actions
from semmap.manipulation.store.model_shapes import shape_of
from semmap.manipulation.suitability import class_of, unsuitable
from tests.seen import seen_by

KINDS = ("grasp", "place", "push", "turn", "open", "put")
FORMS = ("parallel", "multi-finger", "suction")
SHAPES = ("sphere", "cylinder", "cone", "cuboid", None)
FUNCTIONS = ((), ("drinking",), ("wearing",), ("drying", "carrying"), ("sitting",), ("sleeping",))


def is_consistent(kind: str, form: str, shape: str | None, functions: tuple[str, ...]) -> bool:
    """Whether owlrl finds no contradiction in an action."""
    shaped = "" if shape is None else f":hasShape <{class_of(shape)}> ;"
    used = "".join(f":hasFunction <{class_of(use)}> ;" for use in functions)
    graph = rdflib.Graph().parse(
        data="@prefix : <urn:semmap:ontology#> . @prefix ex: <http://example.org/> ."
        f"ex:action a <{class_of(kind)}> ; :actsOn ex:item ; :gripper ex:hand ."
        f"ex:hand a <{class_of(form, 'Gripper')}> . ex:item {shaped} {used} a :ObjectModel .",
        format="turtle",
    )
    return no_clash(graph)


def no_clash(graph: rdflib.Graph) -> bool:
    """Whether owlrl finds that nothing in a graph is in two disjoint classes, by the ontology."""
    graph.parse(schema_folder() / "ontology" / "knowledge" / "manipulation.ttl")
    closure = owlrl.OWLRL_Semantics(graph, False, False, False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        closure.closure()
    # it also takes 0.0 for no xsd:double
    return not any(text.startswith("Disjoint classes") for text in closure.error_messages)


@pytest.mark.parametrize(
    ("case", "suits"),
    [
        (("grasp", "parallel", "sphere", ("wearing",)), True),
        (("grasp", "suction", "sphere", ()), True),
        (("grasp", "suction", "sphere", ("wearing",)), False),
        (("grasp", "suction", "cuboid", ("drinking",)), True),
        (("grasp", "suction", "cuboid", ("drying", "carrying")), False),
        (("grasp", "multi-finger", None, ("sitting",)), False),
        (("place", "suction", "sphere", ("sleeping",)), True),
        (("turn", "parallel", "sphere", ()), False),
        (("push", "parallel", "cylinder", ("sitting",)), True),
    ],
)
def test_what_does_not_suit_is_inconsistent_for_owlrl(
    case: tuple[str, str, str | None, tuple[str, ...]], suits: bool
) -> None:
    assert is_consistent(*case) == suits
    assert (not unsuitable(*case)) == suits


def test_shapes_functions_and_forms_that_do_not_suit() -> None:
    excluded = {case for case in product(KINDS, FORMS, SHAPES, FUNCTIONS) if unsuitable(*case)}
    furniture, textiles = {("sitting",), ("sleeping",)}, {("wearing",), ("drying", "carrying")}
    assert excluded == {
        (kind, form, shape, uses)
        for kind, form, shape, uses in product(KINDS, FORMS, SHAPES, FUNCTIONS)
        if (kind == "grasp" and uses in furniture)
        or (kind == "grasp" and form == "suction" and uses in textiles)
        or (kind in ("push", "turn") and shape == "sphere")
    }
    assert unsuitable("push", "parallel", "sphere") == [
        "a sphere rolls on from where it is pushed to"
    ]


@pytest.mark.parametrize(
    ("types", "suits"),
    [
        (("cup", "drinkware"), True),
        (("teddy_bear", "toy"), False),
        (("potted_plant", "plant"), False),
    ],
)
def test_a_suction_cup_does_not_hold_what_lets_air_through(
    types: tuple[str, ...], suits: bool
) -> None:
    graph = rdflib.Graph()
    text = "@prefix : <urn:semmap:ontology#> . @prefix ex: <http://example.org/> . "
    text += "ex:action a :Grasp ; :actsOn ex:item ; :gripper ex:hand . ex:hand a :SuctionGripper . "
    text += " ".join(f"ex:item :modelOf <{class_of(each)}> ." for each in types)
    assert no_clash(graph.parse(data=text, format="turtle")) == suits
    assert (not unsuitable("grasp", "suction", types=types)) == suits
    assert unsuitable("grasp", "parallel", types=types) == []


def test_a_form_that_the_ontology_does_not_know_excludes_nothing_more() -> None:
    assert unsuitable("grasp", "magnet", "sphere", ["wearing"]) == []


def test_retrieval_proposes_nothing_that_is_excluded_and_tells_why(cups: Map) -> None:
    here = cups.connection
    register_gripper(here, DEFAULT_GRIPPER)
    cups.add_object("ball", mesh=solid_of("sphere", (0.03,)).mesh(), pose=(3.0, 0.5, 0.0305))
    stool = solid_of("cuboid", (0.05, 0.05, 0.06)).mesh()
    cups.add_object("stool", type="chair", mesh=stool, pose=(3.0, 1.5, 0.0305))
    seen = seen_by(here)
    hand = DEFAULT_GRIPPER.stem
    pushed = find_pushes(seen, "ball", gripper=hand)
    assert pushed.rows == []
    assert pushed.problems[0].endswith("a sphere rolls on from where it is pushed to")
    lifted = find_grasps(seen, name="stool", gripper=hand)
    assert lifted.rows == []
    assert "seats and beds carry people" in lifted.problems[0]
    assert find_grasps(seen, name="ball", gripper=hand).rows
    gripper = stored_gripper(here, hand)
    assert known_grasps(seen, "stool", hand, gripper) == []
    assert known_grasps(seen, "ball", hand, gripper)


def test_grasps_that_were_stored_before_are_left_out_too(cups: Map) -> None:
    here = cups.connection
    register_gripper(here, DEFAULT_GRIPPER)
    assert find_grasps(seen_by(here), name="cup1", gripper=DEFAULT_GRIPPER.stem).rows
    here.execute("UPDATE object_model SET functions = '{sleeping}'")
    left = find_grasps(seen_by(here), name="cup1", gripper=DEFAULT_GRIPPER.stem)
    assert left.rows == left.generated == []
    assert "cup1: the ontology excludes a grasp of it by a parallel gripper" in left.problems[0]


def test_stored_actions_are_checked_in_the_graph_of_a_map(cups: Map) -> None:
    """What somebody stored who does not ask the ontology."""
    here = cups.connection
    register_gripper(here, DEFAULT_GRIPPER)
    hand = DEFAULT_GRIPPER.stem
    shape = shape_of(seen_by(here), "cup1")
    grasp = grasp_candidates(shape, stored_gripper(here, hand))[0]
    add_actions(here, "cup1", hand, [grasp])

    def graph() -> rdflib.Graph:
        found = rdflib.Graph()
        for subject, verb, value, _ in facts_of(here, MANIPULATION_TRIPLES):
            found.add((subject, verb, value))
        return found

    own = rdflib.Namespace(SEMMAP)
    assert (None, rdflib.RDF.type, own.ParallelGripper) in graph()
    assert no_clash(graph())
    here.execute("UPDATE object_model SET functions = '{sitting}'")
    assert not no_clash(graph())

"""Links between data sets whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.interlinking.blocking import candidate_pairs
from semmap.interlinking.correspondences import find_correspondences
from semmap.interlinking.interlink import Workbench
from semmap.interlinking.records import InterlinkingError, Records, plain_text
from semmap.interlinking.similarity import compare
from tests.interlinking.data_sets import NAMES_OF_SECOND, interlink, person1, person2, restaurants


@pytest.mark.parametrize(
    ("make", "seed", "asked"),
    [
        (make, seed, asked)
        for make, asked in ((person1, 0.98), (person2, 0.93), (restaurants, 0.75))
        for seed in (1, 2, 3)
    ],
)
def test_five_percent_of_labels_are_enough(make, seed, asked) -> None:
    case = make(seed=seed)
    count = len(case.links) // 20
    found = interlink(case.left, case.right, {}, lambda a, b: (a, b) in case.links, count)
    assert len(found.labels) <= count
    assert found.quality(case.links).f >= asked
    assert not found.unexplained
    links = found.links()
    assert all(((pair in links) == same) for pair, same in found.labels.items())
    assert all(links[pair] == 1 for pair, same in found.labels.items() if same)


def test_properties_correspond_without_their_names() -> None:
    case = person1()
    for c in find_correspondences(case.left, case.right):
        assert c.right == NAMES_OF_SECOND.get(c.left, c.left)


@pytest.mark.parametrize("make", [person1, person2, restaurants])
def test_blocking_loses_no_true_pair(make) -> None:
    case = make()
    pairs, _ = candidate_pairs(case.left, case.right, find_correspondences(case.left, case.right))
    found = {(case.left.keys[i], case.right.keys[j]) for i, j in pairs}
    assert len(case.links - found) <= 0.01 * len(case.links)
    assert len(pairs) < 0.1 * len(case.left) * len(case.right)


def test_links_are_those_of_all_pairs() -> None:
    case = person1(n=60)
    labels = dict.fromkeys(sorted(case.links)[:3], True)
    links = []
    for every_pair in (False, True):
        work = Workbench(case.left, case.right, labels, every_pair=every_pair)
        work.ask(lambda a, b: (a, b) in case.links, 6)
        assert len(work.comparison.pairs) == 3600 or not every_pair
        links.append({*work.interlink().links()})
    assert links[0] == links[1] == case.links


def test_both_directions_find_the_same() -> None:
    case = restaurants(left=60, right=200)
    answers = dict.fromkeys(sorted(case.links)[:6], True)
    there = Workbench(case.left, case.right, answers)
    back = Workbench(case.right, case.left, {(b, a): same for (a, b), same in answers.items()})
    assert {(c.left, c.right) for c in there.correspondences} == {
        (c.right, c.left) for c in back.correspondences
    }
    assert {tuple(p) for p in there.comparison.pairs} == {
        tuple(p)[::-1] for p in back.comparison.pairs
    }


values = st.lists(st.text(alphabet="abc 1.", max_size=6), min_size=1, max_size=2).map(tuple)


@settings(max_examples=50)
@given(st.lists(values, min_size=2, max_size=4), st.lists(values, min_size=2, max_size=4))
def test_similarity_is_symmetric_and_between_0_and_1(left, right) -> None:
    a = Records("a", [str(i) for i in range(len(left))], {"p": left})
    b = Records("b", [str(i) for i in range(len(right))], {"p": right})
    if not all(any(plain_text(v) for of in s.properties["p"] for v in of) for s in (a, b)):
        return
    (one,) = find_correspondences(a, b)
    (back,) = find_correspondences(b, a)
    pairs = np.array([*np.ndindex(len(left), len(right))])
    there = compare(a, b, [one], pairs)
    assert np.array_equal(there, compare(b, a, [back], pairs[:, ::-1]), equal_nan=True)
    known = there[np.isfinite(there)]
    assert ((known >= 0) & (known <= 1)).all()
    for (i, j), value in zip(pairs, there[:, 0], strict=True):
        these, those = ({plain_text(v) for v in of} - {""} for of in (left[i], right[j]))
        assert np.isnan(value) == (not these or not those)
        if these & those and one.measure != "number":
            assert value == 1


def test_bad_input_is_an_error() -> None:
    case = person1(n=20)
    with pytest.raises(InterlinkingError, match=r"'stranger' is not a record of right: correct"):
        interlink(case.left, case.right, {(case.left.keys[0], "stranger"): True})
    with pytest.raises(InterlinkingError, match="occurs twice"):
        Records("twice", ["a", "a"], {"p": [("1",), ("2",)]})
    with pytest.raises(InterlinkingError, match="no records"):
        Records("empty", [], {})
    with pytest.raises(InterlinkingError, match="no record has a value"):
        interlink(Records("blank", ["a"], {"p": [()]}), case.right, {})


def test_a_label_that_contradicts_all_patterns_is_reported() -> None:
    rows = [("x y",), ("x y",), ("z u w",)]
    left = Records("left", ["1", "2", "3"], {"p": rows})
    right = Records("right", ["a", "b", "c"], {"p": rows})
    found = interlink(left, right, {("1", "a"): True, ("2", "b"): False})
    assert found.unexplained == [("1", "a")]
    assert found.links() == {("1", "a"): pytest.approx(1)}
    assert found.pattern == "labelled the same"

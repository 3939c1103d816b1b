"""Labels that are few, wrong, absent, or of other records; against truth and brute force."""

from __future__ import annotations

import random
from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.interlinking.interlink import Interlinking, Workbench
from semmap.interlinking.records import InterlinkingError
from semmap.interlinking.simple_patterns import SimplePatterns, pseudo_f
from semmap.interlinking.version_space import LEVELS, matches
from tests.interlinking.data_sets import Case, interlink, person1, person2, restaurants

SEEDS = (1, 2, 3)
MAKERS = (person1, person2, restaurants)


@cache
def bench(make: Callable[..., Case], seed: int) -> tuple[Case, Workbench]:
    case = make(seed=seed)
    return case, Workbench(case.left, case.right, {})


def asked(make: Callable[..., Case], share: float, wrong: float, draws: int) -> list[float]:
    """F of each draw, with labels of a share of the links, of which some are wrong."""
    found = []
    for seed in SEEDS:
        case, work = bench(make, seed)
        for draw in range(draws):
            rng = random.Random(100 * seed + draw)
            work.forget()
            work.ask(
                lambda a, b, links=case.links, rng=rng: ((a, b) in links) != (rng.random() < wrong),
                round(share * len(case.links)),
            )
            found.append(work.interlink().quality(case.links).f)
    return found


@pytest.mark.parametrize("make", MAKERS)
def test_more_labels_do_not_reduce_f(make) -> None:
    means = [np.mean(asked(make, share, 0, 1)) for share in (0, 0.01, 0.05, 0.1)]
    assert means[0] > 0.9  # without any label
    assert all(b > a - 0.005 for a, b in pairwise(means)), means


@pytest.mark.parametrize("share", [0.05, 0.1])
@pytest.mark.parametrize("make", MAKERS)
def test_five_percent_of_wrong_answers_cost_at_most_5_percent(make, share) -> None:
    assert np.mean(asked(make, share, 0, 1)) - np.mean(asked(make, share, 0.05, 3)) <= 0.05


@pytest.mark.parametrize("make", [person1, person2])
def test_wrong_labels_of_a_file_are_doubted_and_no_right_ones(make) -> None:
    case = make(seed=4)
    rng = random.Random(4)
    links = sorted(case.links)
    strangers = [(a, links[(i + 7) % len(links)][1]) for i, (a, _) in enumerate(links)]
    labels = dict.fromkeys(links[:20], True) | dict.fromkeys(
        [pair for pair in strangers[:20] if pair not in case.links], False
    )
    flipped = rng.sample(sorted(labels), 2)
    found = interlink(case.left, case.right, labels | {p: not labels[p] for p in flipped})
    assert {*found.doubted} == {*flipped}
    assert found.quality(case.links).f > 0.95
    assert all(((pair in found.links()) == labels[pair]) for pair in flipped)


def test_a_person_who_errs_is_asked_again() -> None:
    case = person1(n=100, seed=5)
    answers: dict[tuple[str, str], int] = {}

    def answer(a: str, b: str) -> bool:
        """Wrong at the third pair, and right about it when asked again."""
        answers[a, b] = answers.get((a, b), 0) + 1
        wrong = len(answers) == 3 and answers[a, b] == 1
        return ((a, b) in case.links) != wrong

    work = Workbench(case.left, case.right, {})
    assert work.ask(answer, 16) == 16
    assert sum(answers.values()) == 16
    assert max(answers.values()) == 3
    assert all(same == (pair in case.links) for pair, same in work.labels.items())
    assert not work.interlink().doubted


def test_contradictory_labels_are_not_doubted_where_they_are_half() -> None:
    case = person1(n=40, seed=6)
    (first, *_) = sorted(case.links)
    second = sorted(case.links)[1]
    found = interlink(case.left, case.right, {first: True, second: False})
    assert not found.doubted
    assert first in found.links()
    assert second not in found.links()


def test_a_start_without_labels() -> None:
    for make, least in ((person1, 0.99), (person2, 0.95), (restaurants, 0.85)):
        case, work = bench(make, 1)
        work.forget()
        found: Interlinking = work.interlink()
        assert found.quality(case.links).f >= least
        assert not found.labels
        assert found.pattern.startswith("likelihood >= ")
        v = work.comparison.likelihood
        threshold = float(found.pattern.rpartition(" ")[2])
        assert len(found.pairs) == np.count_nonzero(v >= threshold - 1e-9)
        assert (found.confidence >= threshold - 1e-9).all()


def test_labels_of_unknown_records_are_dropped_and_counted() -> None:
    case = person1(n=30, seed=7)
    labels = dict.fromkeys(sorted(case.links)[:4], True)
    strange = {
        ("http://a/none", "http://b/none"): True,
        (case.left.keys[0], "http://b/none"): False,
    }
    found = interlink(case.left, case.right, labels | strange)
    assert found.dropped == 2
    assert dict(found.labels) == labels
    assert found.links() == interlink(case.left, case.right, labels).links()
    with pytest.raises(InterlinkingError, match=r"is not a record of .*or exchange the data sets"):
        interlink(case.right, case.left, labels)


rows = st.lists(
    st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=8, unique=True
)


@given(rows, st.data())
def test_the_pseudo_f_measure_is_that_of_sets(candidates, data) -> None:
    links = data.draw(st.lists(st.sampled_from(candidates), min_size=1, unique=True))
    linked = max(len({a for a, _ in links}), len({b for _, b in links}))
    most = min(len({a for a, _ in candidates}), len({b for _, b in candidates}))
    precision, recall = linked / len(links), linked / max(most, linked)
    found = pseudo_f(np.array(links), np.array(candidates))
    assert found == pytest.approx(2 * precision * recall / (precision + recall))
    assert 0 < found <= 1


def test_simple_patterns_are_scored_by_their_links() -> None:
    _, work = bench(restaurants, 1)
    pairs, levels = work.comparison.pairs, work.comparison.levels
    found = SimplePatterns.of(pairs, levels)
    assert len(found.patterns) == 4 * (LEVELS + 1)
    for row, score in list(zip(found.patterns, found.scores, strict=True))[::17]:
        linked = matches(row[None], levels)[:, 0]
        assert score == pytest.approx(pseudo_f(pairs[linked], pairs))

"""Sentences of the grammar: each form is understood, and an unknown one has the nearest."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.belief.error import BeliefError
from semmap.belief.grammar import LISTS, SENTENCES, spoken, write_grammar
from semmap.belief.sentences import nearest_sentence, understand
from tests.belief.jsgf import generated

NAMES = {
    "things": ["coke1", "Tea_Pot"],
    "places": ["KitchenTable", "hall"],
    "types": ["mug", "tea_pot"],
    "actions": ["grasp"],
    "kinds": ["pot"],
    "groups": ["pot"],
    "hours": ["noon", "eight in the morning"],
}


EVERY = generated(write_grammar(NAMES, "jsgf"))


def test_all_forms_are_generated() -> None:
    # names, articles and relations, counted from the forms of the grammar
    assert len(EVERY) == len({*EVERY}) == 4 + 4 + 16 + 4 + 32 + 16 + 16 + 1 + 2 + 2 + 8 + 8 + 4 + 8


@pytest.mark.parametrize("sentence", EVERY)
def test_each_sentence_of_the_grammar_is_understood(sentence: str) -> None:
    found = understand(sentence, NAMES)
    assert found.form in SENTENCES
    slots = [word for word in found.form.split() if word[0] == "<"]
    for slot, name in zip(slots, found.names, strict=True):
        assert name in NAMES[LISTS[slot[1:-1]]]
        assert spoken(name) in sentence
    assert understand(str(found), NAMES) == found
    assert understand(sentence.upper() + ".", NAMES) == found


def letters_apart(a: str, b: str) -> int:
    """The letters to delete and insert: by the longest common subsequence."""
    row = [0] * (len(b) + 1)
    for x in a:
        new = [0]
        for j, y in enumerate(b):
            new.append(row[j] + 1 if x == y else max(row[j + 1], new[j]))
        row = new
    return len(a) + len(b) - 2 * row[-1]


def words_apart(a: list[str], b: list[str]) -> int:
    """The edit distance of two lists of words, over all alignments."""
    if not a or not b:
        return sum(map(len, a + b))
    return min(
        words_apart(a[1:], b[1:]) + letters_apart(a[0], b[0]),
        words_apart(a[1:], b) + len(a[0]),
        words_apart(a, b[1:]) + len(b[0]),
    )


# the words have different letters, so that both measures of two words agree
WORDS = st.sampled_from(["find", "go", "to", "the", "coke", "1", "hall", "is", "in", "xyz", "a"])


@given(st.lists(WORDS, max_size=5))
def test_the_nearest_sentence_is_that_of_an_enumeration(words: list[str]) -> None:
    names = {"things": ["coke1"], "places": ["hall"]}
    every = generated(write_grammar(names, "jsgf"))
    near = nearest_sentence(" ".join(words), names)
    assert near in every
    least = min(words_apart(words, each.split()) for each in every)
    assert words_apart(words, near.split()) == least


@pytest.mark.parametrize(
    ("sentence", "nearest"),
    [
        ("where is the cola", "where is the coke 1"),
        ("bring coke one to the hal", "bring coke 1 to the hall"),
        ("please find the tea pod", "find the tea pot"),
        ("", "grasp"),
    ],
)
def test_an_unknown_sentence_has_the_nearest_one_in_its_error(sentence: str, nearest: str) -> None:
    with pytest.raises(BeliefError, match=f'the nearest is "{nearest}"'):
        understand(sentence, NAMES)


def test_the_nearest_sentence_has_its_articles() -> None:
    names = {"types": ["onion", "food", "apple"]}
    assert nearest_sentence("a onions is an food", names) == "an onion is a food"
    assert str(understand("a onion is a apple", names)) == "an onion is an apple"


def test_names_that_are_spoken_alike_are_an_error() -> None:
    with pytest.raises(BeliefError, match='ambiguous: it may be "where is the tea_pot" or "where'):
        understand("where is the tea pot", {"things": ["tea_pot", "TeaPot"]})
    with pytest.raises(BeliefError, match="the map has no names"):
        understand("where is the tea pot", {})


def test_a_question_states_nothing() -> None:
    for sentence in ("where is the coke 1", "grasp"):
        with pytest.raises(
            BeliefError, match=r"states nothing: `semmap ask` .*the <thing> is in the"
        ):
            _ = understand(sentence, NAMES).stated

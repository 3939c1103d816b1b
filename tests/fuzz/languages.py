"""The languages: queries and updates of fields, regions as text, and goals."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from random import Random

import numpy as np

from planner.tasks import TaskState, parse_goal
from planner.tasks.problem_builder import build_problem
from semmap.fields import Box, RegionMap
from semmap.fields.queries import QueryError, SelectResult, query, update
from semmap.fields.regions.region_text import FORMS
from tests.fields.queries.arrays import PREFIX, kitchen
from tests.fields.queries.test_query import ANSWERS, STORES
from tests.fuzz.files import network
from tests.fuzz.grammar import Grammar
from tests.fuzz.kind import Kind
from tests.fuzz.mutate import NUMBERS, bytes_of, lines_of, words_of
from tests.oracles.region_map import check_region_map
from tests.planner.tasks.test_domain_file import garden

NOUNS = (
    ":mug1",
    ":human1",
    "'mug'",
    ":table1",
    ":object",
    "1",
    "0.5",
    "-1e308",
    "?a",
    "?b",
    "?v",
    "_:x",
    "[]",
)
VERBS = (
    ":occupiedBy",
    ":inFieldOfView",
    ":on",
    ":free",
    ":distanceToPerson",
    ":containsObject",
    "a",
    "?p",
    ":occupies",
)
FUNCTIONS = (
    "STR",
    "STRLEN",
    "UCASE",
    "ABS",
    "CEIL",
    "FLOOR",
    "ROUND",
    "BOUND",
    ":x",
    ":y",
    ":z",
    "!",
    "-",
    "COUNT",
    "SUM",
    "MIN",
    "isIRI",
    "LANG",
    "NOW",
    "RAND",
)
OPERATORS = ("=", "!=", "<", ">", "<=", ">=", "+", "-", "*", "/", "&&", "||", "IN", "NOT IN")


MOST_CHECKED = 1_000_000
"""Voxels that are compared with an array of them in the time of a case."""


class FieldsGrammar(Grammar):
    """Sentences of the query language of fields."""

    NOUNS = DATA = NOUNS
    VERBS = VERBS

    def query(self) -> str:
        pick = self.random.choice
        head = pick(
            (
                "SELECT *",
                "SELECT ?v",
                "SELECT DISTINCT ?a ?b",
                "ASK",
                "SELECT ?a (COUNT(*) AS ?n)",
                f"SELECT ({self.expression()} AS ?n)",
            )
        )
        tail = "".join(
            pick(
                (
                    "",
                    f" ORDER BY {self.expression()}",
                    " GROUP BY ?a",
                    f" LIMIT {pick(NUMBERS)}",
                    f" OFFSET {pick(NUMBERS)}",
                    f" HAVING ({self.expression()})",
                    " STORE :containsObject",
                    ' DURING "PT10S"^^<http://www.w3.org/2001/XMLSchema#duration>',
                    ' AT "2026-01-31T12:00:00Z"^^<http://www.w3.org/2001/XMLSchema#dateTime>',
                )
            )
            for _ in range(pick((0, 0, 1, 3)))
        )
        return f"{head} {pick(('', 'WHERE '))}{self.group()}{tail}"

    def expression(self) -> str:
        self.left -= 1
        pick = self.random.choice
        if self.left < 0 or self.random.random() < 0.3:
            return pick((*NOUNS, *NUMBERS, "'a'", "true"))
        match self.random.randrange(5):
            case 0:
                return f"{pick(FUNCTIONS)}({self.expression()})"
            case 1:
                return f"REGEX(STR(?a), '{self.regex()}', '{pick(('', 'i', 'x', 'imsx', 'q'))}')"
            case 2:
                return f"IF({self.expression()}, {self.expression()}, {self.expression()})"
            case 3:
                return f":distance({self.expression()}, {self.expression()})"
            case _:
                return f"({self.expression()} {pick(OPERATORS)} {self.expression()})"

    def regex(self) -> str:
        pieces = (
            "a",
            "u",
            ".",
            "(",
            ")",
            "*",
            "+",
            "?",
            "{2}",
            "{1,99}",
            "|",
            "[",
            "]",
            "^",
            "$",
            "\\\\w",
            "\\\\1",
            "(?=",
            "(?:",
            "\\\\",
        )
        return "".join(self.random.choice(pieces) for _ in range(self.random.randrange(12)))

    def region(self) -> str:
        name = self.random.choice((*FORMS, "TORUS"))
        count = self.random.choice((3, 4, 5, 6, 8, 8, 10, 30))
        numbers = (
            self.random.choice(NUMBERS)
            if self.random.random() < 0.3
            else f"{self.random.uniform(-9, 9):.3g}"
            for _ in range(count)
        )
        comma = ", " if name in ("HULL", "POINTS") else " "
        text = [*numbers]
        rows = [" ".join(text[i : i + 3]) for i in range(0, count, 3)]
        return f"{name}({comma.join(rows)})"

    def request(self) -> str:
        literal = f'"{self.region()}"^^:region'
        subject = self.random.choice((":mug1", ":a", "_:new", "?a", "[]"))
        match self.random.randrange(4):
            case 0 | 1:
                verb = self.random.choice(("INSERT", "INSERT", "DELETE"))
                return f"{verb} DATA {{ {subject} :occupies {literal} }}"
            case 2:
                return f"DELETE WHERE {{ {subject} :occupies ?v }}"
            case _:
                place = self.random.choice((literal, "?v"))
                return f"INSERT {{ {subject} :occupies {place} }} WHERE {self.group()}"


def grammar_query(random: Random, _: bytes, __: Sequence[bytes]) -> bytes:
    """A new query."""
    return (PREFIX + FieldsGrammar(random).query()).encode("utf-8", "replace")


def grammar_update(random: Random, _: bytes, __: Sequence[bytes]) -> bytes:
    """New requests."""
    requests = (FieldsGrammar(random).request() for _ in range(random.choice((1, 1, 2, 5))))
    return (PREFIX + " ; ".join(requests)).encode("utf-8", "replace")


def grammar_region(random: Random, _: bytes, __: Sequence[bytes]) -> bytes:
    """A new region as text."""
    return FieldsGrammar(random).region().encode()


def queries() -> list[bytes]:
    texts = [each[0] if isinstance(each, tuple) else each for each in ANSWERS.values()]
    texts += [each[0] if isinstance(each, tuple) else each for each in STORES.values()]
    return [(PREFIX + text).encode() for text in texts if isinstance(text, str)]


def run_query(data: bytes, _: Path) -> None:
    answer = query(kitchen(), data.decode("utf-8", "replace"))
    if isinstance(answer, SelectResult):
        answer.as_json()


def updates() -> list[bytes]:
    return [
        (PREFIX + text).encode()
        for text in (
            'INSERT DATA { :mug1 :occupies "SPHERE(1 2 0.8 0.05)"^^:region . '
            '_:new :occupies "BOX(0 0 1 2 2 2)"^^:region }',
            "INSERT { _:zone :occupies ?v } WHERE { ?v :inFieldOfView :human1 FILTER(:z(?v) < 1) }",
            "DELETE WHERE { :a :occupies ?v }",
            'DELETE DATA { :a :occupies "HULL(0 0 0, 1 0 0, 0 1 0, 0 0 1)"^^:region } ; '
            'INSERT DATA { :b :occupies "CYLINDER(0 0 0 1 2 0 0 1)"^^:region }',
            'INSERT DATA { :c :occupies "CONE(0 0 0 0 0 1 0.5 2)"^^:region , '
            '"POINTS(1 1 1, 2 2 2)"^^:region }',
        )
    ]


def run_update(data: bytes, _: Path) -> None:
    text = data.decode("utf-8", "replace")
    catalogue = kitchen()
    regions = RegionMap(catalogue.voxel_size)
    regions.insert("a", Box((0, 0, 0), (2, 2, 2)))
    before = regions.voxels("a")
    try:
        update(regions, text, catalogue)
    except QueryError:
        assert regions.entities() == {"a"}, "a refused update changes nothing"
        assert len(regions.voxels("a")) == len(before)
        raise
    finally:
        check_region_map(regions._native)


def run_region(data: bytes, _: Path) -> None:
    regions = RegionMap(0.05)
    literal = json.dumps(data.decode("utf-8", "replace"))
    update(regions, f"{PREFIX}INSERT DATA {{ :a :occupies {literal}^^:region }}")
    if regions.size("a") < MOST_CHECKED:
        check_region_map(regions._native)


def goals() -> Iterator[str]:
    yield "on(cup1, desk1) and in(robot, kitchen)"
    yield "on(a cup, desk1), on(another cup,sink1)"
    yield " on ( cup1 , 'desk1' ) , and in(robot, lab1) "
    yield "carries(robot, a cup)"
    yield "in(cup2, lab1)"


def grammar_goal(random: Random, _: bytes, __: Sequence[bytes]) -> bytes:
    """New atoms."""
    words = (
        "cup1",
        "a cup",
        "another cup",
        "the desk",
        "desk1",
        "robot",
        "lab1",
        "'x y'",
        "sink1",
        "",
        "thing",
    )
    atoms = (
        f"{random.choice(('on', 'in', 'carries', 'onn', ''))}"
        f"({', '.join(random.choice(words) for _ in range(random.choice((0, 1, 2, 2, 2, 3))))})"
        for _ in range(random.choice((1, 2, 3, 10)))
    )
    return random.choice((" and ", ", ", " ", ",")).join(atoms).encode()


def run_goal(data: bytes, _: Path) -> None:
    goal = parse_goal(data.decode("utf-8", "replace"))
    problem = build_problem(network(), garden(), TaskState("lab1"), goal)
    assert np.isfinite(problem.pickup)


TEXT = [words_of, words_of, bytes_of, lines_of]

LANGUAGE_KINDS = [
    Kind("query", queries, [*TEXT, *[grammar_query] * 4], run_query),
    Kind("update", updates, [*TEXT, *[grammar_update] * 4], run_update),
    Kind(
        "region",
        lambda: [b"SPHERE(0 0 0 1)", b"BOX(0 0 0 1 1 1)"],
        [grammar_region, words_of],
        run_region,
    ),
    Kind(
        "goal",
        lambda: [g.encode() for g in goals()],
        [*TEXT, *[grammar_goal] * 4],
        run_goal,
    ),
]

"""Each requirement of GeoSPARQL 1.1 is met, or says why it is not."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import psycopg
import pytest

import semmap
from benchmarks.geosparql import REQUIREMENTS, Requirement, failed, small_map
from tests.conftest import MakeDatabase


@pytest.fixture(scope="module")
def small(make_database: MakeDatabase) -> Iterator[psycopg.Connection[Any]]:
    url = make_database().render_as_string(hide_password=False)
    with semmap.connect(url) as database:
        yield small_map(database)


@pytest.mark.parametrize("requirement", REQUIREMENTS, ids=[r.name for r in REQUIREMENTS])
def test_a_requirement_is_met(small: psycopg.Connection[Any], requirement: Requirement) -> None:
    assert failed(small, requirement) == []
    assert bool(requirement.missing) != bool(requirement.checks or requirement.same)


def test_a_wrong_check_is_reported(small: psycopg.Connection[Any]) -> None:
    wrong = Requirement(
        "wrong",
        ("ASK { :cup a geo:Geometry }",),
        (("SELECT ?x { ?x a geo:Geometry }", "SELECT ?x { ?x a geo:Feature }"),),
    )
    assert len(failed(small, wrong)) == 2

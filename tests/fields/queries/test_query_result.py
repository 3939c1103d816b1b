"""Rows of an answer, which are made block by block."""

from __future__ import annotations

from itertools import islice
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.fields.queries import query_result
from semmap.fields.queries.query_result import SelectResult
from semmap.fields.queries.table import TermColumn

BLOCK = 4


def answer(cells: list[int | None], columns: int) -> SelectResult:
    """Return an answer with some columns of these numbers."""
    bound = np.array([cell is not None for cell in cells], bool)
    column = TermColumn("number", np.array([cell or 0 for cell in cells], float), bound)
    return SelectResult(tuple("ab"[:columns]), (column,) * columns, len(cells), (), 0.05)


@given(st.lists(st.none() | st.integers(-9, 9), max_size=3 * BLOCK + 1), st.integers(0, 2))
def test_rows_are_the_cells_of_all_blocks(cells: list[int | None], columns: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(query_result, "_BLOCK", BLOCK)
        assert list(answer(cells, columns)) == [(cell,) * columns for cell in cells]


def test_the_first_rows_of_many_take_one_block(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []
    plain = SelectResult._plain

    def counted(result: SelectResult, column: TermColumn) -> list[Any]:
        made.append(len(column))
        return plain(result, column)

    monkeypatch.setattr(SelectResult, "_plain", counted)
    many = answer(list(range(1_000_000)), 1)
    assert list(islice(many, 3)) == [(0,), (1,), (2,)]
    assert sum(made) < 10_000

"""Tables: a line a row wherever they fit, aligned by the columns that a terminal takes."""

from __future__ import annotations

from unittest.mock import patch

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from semmap.cli import output
from semmap.cli.output import cell_width, show_rows


def test_a_pipe_gets_one_line_a_row_however_long(capsys: pytest.CaptureFixture[str]) -> None:
    show_rows(["name", "text"], [("a", "x" * 500), ("杯", "cup")], False)
    lines = capsys.readouterr().out.splitlines()
    assert lines == ["name  text", "a     " + "x" * 500, "杯    cup"]


def test_a_narrow_terminal_folds(capsys: pytest.CaptureFixture[str]) -> None:
    assert output.out is not None  # made here, so that it has no styles in the tests that follow
    with patch("sys.stdout.isatty", return_value=True):
        show_rows(["name", "text"], [("a", "x" * 500)], False)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 3
    assert max(map(len, lines)) <= 160
    assert "".join(lines).count("x") == 501


@given(st.text("aZ 9é杯한ｗ\u0301"))
def test_cells_are_as_wide_as_rich_measures_them(cell: str) -> None:
    assert cell_width(cell) == cell_len(cell)

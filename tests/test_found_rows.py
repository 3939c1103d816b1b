"""Rows as a notebook shows them."""

from __future__ import annotations

from xml.etree import ElementTree

from semmap.found_rows import FoundRows, html_table
from semmap.geometry.pose import Pose

ROWS = [
    {"name": "a <b> & c", "pose": Pose(1, 2, 0.123456), "gone": None, "all": {"x": 1}},
    {"name": "mug", "pose": None, "gone": 1.0, "all": {}},
]


def test_the_table_has_each_short_value_escaped() -> None:
    table = ElementTree.fromstring(html_table(ROWS))
    cells = [["".join(cell.itertext()) for cell in line] for line in table]
    assert cells == [
        ["name", "pose", "gone"],
        ["a <b> & c", "1, 2, 0.1235, 0, 0, 0, 1", ""],
        ["mug", "", "1"],
    ]
    assert html_table([]) == "<table><tr></tr></table>"


def test_rows_are_a_sequence_with_problems() -> None:
    found = FoundRows(ROWS, ["shelf: has <no> mesh"])
    assert (len(found), found[0], found[1:], list(found)) == (2, ROWS[0], ROWS[1:], ROWS)
    assert "<p>shelf: has &lt;no&gt; mesh</p>" in found._repr_html_()
    assert not FoundRows([])

"""Kept answers of queries in grids: data, unless a policy lets them count for a time."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt
from sqlalchemy import Engine

import semmap
from navgrid.policy import Policy, PolicyError

RULE = "{property: occupiedBy, layer: floor}"
QUERY = "SELECT ?v { ?v :occupiedBy 'crate' } STORE :occupiedBy"


def test_a_kept_query_is_data_until_a_policy_lets_it_count(house: Engine, tmp_path: Path) -> None:
    default = (resources.files("navgrid") / "policy.yaml").read_text("utf-8")
    assert RULE in default
    counting = tmp_path / "policy.yaml"
    counting.write_text(default.replace(RULE, RULE[:-1] + ", kept: 3600}"))
    with semmap.connect(house.url.render_as_string(hide_password=False)) as db:
        here = db.map("house")
        empty = here.grid()
        before = empty.cells
        row, column = np.argwhere(distance_transform_edt(before == 0) > 12)[0]
        x, y = np.array(empty.grid.origin[:2]) + 0.05 * np.array((column, row))
        here.add_object("crate", type="box", size=(0.4, 0.4, 0.4), pose=(float(x), float(y), 0))
        assert here.fields.query(QUERY, keep="looked").stored["voxels"] > 100
        here["crate"].delete()
        assert np.array_equal(here.grid().cells, before), "it blocked for ever"
        named = here.grid(fields=["looked"]).cells
        assert 64 <= ((named == 100) & (before == 0)).sum() <= 121
        assert np.array_equal(here.grid(policy=counting).cells, named)
        here.execute("UPDATE field_version SET at = at - interval '2 hours' WHERE answer")
        assert np.array_equal(here.grid(policy=counting).cells, before), "it has expired"
        here.fields.forget("looked")


def test_a_policy_keeps_answers_for_seconds() -> None:
    text = "layers: {a: }\nrules: []\nfields: [{property: p, layer: a, kept: KEPT}]"
    assert Policy.parse(text.replace("KEPT", "5")).keeps("p") == 5
    assert Policy.parse(text.replace("KEPT", "5")).keeps("q") == 0
    for wrong in ("-1", "for ever", ".nan"):
        with pytest.raises(PolicyError, match="field rule 1: kept is"):
            Policy.parse(text.replace("KEPT", wrong))

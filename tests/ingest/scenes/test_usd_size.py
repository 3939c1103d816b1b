"""The size of a stage is at least the number of prims that Pixar's library composes."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from pxr import Sdf, Usd

from semmap.ingest.scenes.usd_scene import read_usd
from semmap.ingest.scenes.usd_size import stage_size
from semmap.ingest.world import WorldError
from tests.fuzz.bombs import usda, usda_doubling

TWO = 'def "a" { def "b" { def "c" {} } }'


def lines(text: str) -> str:
    """Break lines where USD requires it."""
    return text.replace("{", "{\n").replace("}", "\n}\n").replace("prepend", "\nprepend")


def other(folder: Path, text: str) -> None:
    usda(folder, lines(text)).rename(folder / "other.usda")


@pytest.mark.parametrize(
    "text",
    [
        TWO,
        f'{TWO} def "x" (references = </a>) {{ def "y" (inherits = </a>) {{}} }}',
        f'{TWO} def "x" (references = </a>) {{}} def "y" (references = </x/b>) {{}}',
        'def "x" (references = @other.usda@</a>) {} def "y" (payload = @other.usda@) {}',
        'def "x" (variants = { string v = "one" } prepend variantSets = "v") { variantSet "v" = '
        '{ "one" { def "p" (references = @other.usda@</a>) {} } "two" {} } }',
    ],
)
def test_the_size_is_an_upper_bound(tmp_path: Path, text: str) -> None:
    other(tmp_path, TWO.replace('"a"', '"a" (references = </z>)') + ' def "z" { def "w" {} }')
    path = usda(tmp_path, lines(text))
    layer = Sdf.Layer.FindOrOpen(str(path))
    stage = Usd.Stage.Open(layer)
    composed = len(list(stage.Traverse()))
    assert composed < stage_size(layer) <= 3 * composed + 3


def test_layers_below_count_as_one_with_those_above(tmp_path: Path) -> None:
    other(tmp_path, 'def "x" (references = </a>) {}')
    path = tmp_path / "case.usda"
    path.write_text(f"#usda 1.0\n(subLayers = [@other.usda@])\n{lines(TWO)}")
    assert stage_size(Sdf.Layer.FindOrOpen(str(path))) == 1 + 3 + 1 + 3


@pytest.mark.parametrize("arc", ["references = ", "inherits = ", "payload = "])
def test_prims_that_double_are_refused_before_they_are_composed(tmp_path: Path, arc: str) -> None:
    with pytest.raises(WorldError, match=r"prims, the limit is 250,000 prims. .*SEMMAP_MAX_PRIMS"):
        read_usd(usda_doubling(tmp_path, 20, arc))


def test_a_prim_in_itself_is_refused(tmp_path: Path) -> None:
    path = usda(tmp_path, lines('def "a" { def "b" (references = </a>) {} }'))
    assert math.isinf(stage_size(Sdf.Layer.FindOrOpen(str(path))))
    with pytest.raises(WorldError, match=r"its prims contain each other\. Remove the cycle"):
        read_usd(path)

"""Links of data sets by methods of a database; the true pairs are known."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import semmap
from semmap.interlinking.interlink import PairQuestion
from tests.conftest import MakeDatabase

NAMES = ("red cup", "blue bowl", "steel pan", "oak tray", "glass jar", "tea pot", "salt mill")
TRUE = {(name, str(9 - number)) for number, name in enumerate(NAMES)}


@pytest.fixture(scope="module")
def kitchen(make_database: MakeDatabase) -> Iterator[semmap.Map]:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        kitchen = db.create_map("kitchen")
        for number, name in enumerate(NAMES):
            kitchen.add_object(name, pose=(number, 0, 0), size=(0.1 + number / 20, 0.2, 0.3))
        yield kitchen


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Rows of the same objects, with typing errors."""
    path = tmp_path_factory.mktemp("shop") / "shop.csv"
    rows = [
        f"{9 - i},{name.replace('e', 'ee', 1)},{0.1 + i / 20:.2f},0.2,0.31"
        for i, name in enumerate(NAMES)
    ]
    path.write_text("\n".join(["id,title,w,l,h", *rows, "99,garden hose,9,1.5,1"]))
    return path


def test_a_map_is_linked_with_a_file(kitchen: semmap.Map, shop: Path) -> None:
    db = kitchen.database
    asked: list[PairQuestion] = []

    def answer(pair: PairQuestion) -> bool | None:
        asked.append(pair)
        return (pair.left, pair.right) in TRUE

    found = db.interlink(kitchen, shop, {("red cup", "9"): True}, ask=answer, questions=4)
    assert len(asked) == 4
    for pair in asked:
        ((_, left, _), *_) = [value for value in pair.values if value[0] == "name"]
        assert left == (pair.left,)
    quality = found.quality(TRUE)
    assert (quality.precision, quality.recall > 0.8) == (1.0, True)
    (stored,) = db.list_link_sets()
    assert (stored["id"], stored["links"], stored["left"]) == (
        found.link_set,
        len(found.pairs),
        "map kitchen",
    )
    assert found.link_set is not None
    merged = db.merged_records(found.link_set)
    linked = {(*row["left_keys"], *row["right_keys"]) for row in merged if row["resource"]}
    assert linked == set(found.links())
    unknown = {("gold cup", "9"): True}
    again = db.interlink(kitchen, shop, dict.fromkeys(TRUE, True) | unknown, store=False)
    assert again.dropped == 1
    assert (again.link_set, set(again.links())) == (None, TRUE)
    assert db.undo_links(found.link_set) == len(found.pairs)
    assert db.list_link_sets() == []


def test_bad_input_is_refused_in_words(kitchen: semmap.Map, shop: Path, tmp_path: Path) -> None:
    db = kitchen.database
    for sets, labels, message in (
        ((kitchen, tmp_path / "gone.csv"), {}, r"cannot be read \(No such file"),
        ((kitchen, tmp_path / "gone.txt"), {}, r"ends in .txt: give a file that ends in one of"),
        ((kitchen, shop), {("gold cup", "9"): True}, "'gold cup' is not a record of map"),
        ((kitchen, shop), tmp_path / "gone.csv", r"cannot be read \(No such file"),
        ((kitchen, "models"), {}, "models: has no records"),
    ):
        with pytest.raises(ValueError, match=message):
            db.interlink(*sets, labels)  # type: ignore[arg-type]
    for number in (77, 2**70):
        with pytest.raises(LookupError, match=f"there is no link set {number}"):
            db.merged_records(number)
        with pytest.raises(LookupError, match=f"there is no link set {number}"):
            db.undo_links(number)

"""Pictures as files: pixels, or lines that are drawn again."""

from __future__ import annotations

import re
import threading
import warnings
import weakref
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

from semmap.draw.floor_plan import floor_plan
from semmap.draw.palette import ROOMS
from semmap.draw.picture import Picture
from semmap.garbage import no_garbage_collection
from tests.draw.storeys import two_rooms

PATH = "{http://www.w3.org/2000/svg}path"


def test_a_plan_as_svg_has_the_rooms_as_outlines(tmp_path: Path) -> None:
    picture = Picture.stacked([Picture.drawn(partial(floor_plan, two_rooms()))])
    saved = picture.save(tmp_path / "new" / "plan.svg")
    root = ElementTree.parse(saved).getroot()
    assert root.tag == PATH.replace("path", "svg")
    for kind in ("lab", "kitchen"):
        sizes = [
            np.ptp(
                np.array(re.findall(r"[-\d.]+", path.get("d", "")), float).reshape(-1, 2), axis=0
            )
            for path in root.iter(PATH)
            if f"fill: {ROOMS[kind]}" in path.get("style", "")
        ]
        wide, high = max(sizes, key=lambda size: float(np.prod(size)))
        assert wide / high == pytest.approx(4 / 3, rel=0.01)  # both rooms measure 4 x 3 m
    assert picture.save(tmp_path / "plan.pdf").read_bytes().startswith(b"%PDF")
    assert picture.save(tmp_path / "plan.png").read_bytes() == picture.png


def test_what_a_picture_cannot_be_saved_as_is_refused(tmp_path: Path) -> None:
    page = Picture.drawn(partial(floor_plan, two_rooms()))
    with pytest.raises(ValueError, match=r"is a \.png, \.svg or \.pdf file"):
        page.save(tmp_path / "plan.jpg")
    with pytest.raises(ValueError, match="several storeys are one"):
        Picture.stacked([page, page]).save(tmp_path / "plan.pdf")
    assert list(tmp_path.iterdir()) == []


def test_pictures_of_two_threads_leave_the_settings_of_the_process() -> None:
    import matplotlib

    before = [*warnings.filters], dict(matplotlib.rcParams)
    began, ended = threading.Event(), threading.Event()

    def first(path: Path) -> None:
        began.wait(0.5)  # for the second, which would save the settings of this one
        path.touch()

    def second(path: Path) -> None:
        began.set()
        ended.wait(0.5)
        path.touch()

    with ThreadPoolExecutor() as pool:
        one, two = pool.submit(Picture.drawn, first), pool.submit(Picture.drawn, second)
        one.result()
        ended.set()
        two.result()
    assert ([*warnings.filters], dict(matplotlib.rcParams)) == before


def test_what_a_picture_was_drawn_with_is_gone_at_once() -> None:
    figures: list[weakref.ref[Figure]] = []

    def draw(path: Path) -> None:
        figure = Figure()
        figure.savefig(path)
        figures.append(weakref.ref(figure))

    with no_garbage_collection():
        Picture.drawn(draw)
        assert figures[0]() is None

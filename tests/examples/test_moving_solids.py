"""The demonstration of moving solids: its story, its keys, and where there is no window."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import matplotlib
import numpy as np
import pytest
from matplotlib.backend_bases import KeyEvent
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from semmap.fields.relations.facts import RelationEvent, RelationFact
from tests.examples.script import load_example

SCRIPT = Path(__file__).parents[2] / "examples/moving_solids.py"


@pytest.fixture(scope="module")
def example() -> ModuleType:
    return load_example("moving_solids")


def test_the_story(example: ModuleType) -> None:
    """What it is about begins and ends, once each."""
    scene = example.Scene()
    heard: list[RelationEvent] = [*scene.begun]
    scene.events.subscribe(heard.append)
    for _, moves in example.STORY:
        for name, by, turn in moves:
            scene.move(name, by, turn)
    for begins, fact in (
        (True, RelationFact("on", "mug", "table")),
        (False, RelationFact("on", "mug", "table")),
        (True, RelationFact("in", "mug", "zone_943")),
        (False, RelationFact("in", "mug", "zone_943")),
        (True, RelationFact("sees", "human1", "mug")),
        (False, RelationFact("sees", "human1", "mug")),
        (True, RelationFact("touching", "ball", "ring")),
        (False, RelationFact("touching", "ball", "ring")),
        (True, RelationFact("touching", "mug", "wedge")),
        (True, RelationFact("on", "wedge", "table")),
    ):
        assert sum(e.fact == fact and e.began == begins for e in heard) == 1, (begins, fact)
    sets = scene.sets()
    assert sum(each.voxels for each in sets.values()) == scene.regions.memory().active_voxels


def test_keys_move_the_chosen(example: ModuleType) -> None:
    figure = Figure(figsize=(6, 4))
    canvas = FigureCanvasAgg(figure)
    window = example.LivePicture(figure)

    def press(key: str) -> None:
        canvas.callbacks.process("key_press_event", KeyEvent("key_press_event", canvas, key))

    assert window.names[0] == "mug"
    before = window.scene.at["mug"][0].copy()
    for key in ("right", "up", "pagedown", "q"):
        press(key)
    assert window.scene.at["mug"][0] - before == pytest.approx((0.05, 0.05, -0.05))
    press("tab")
    assert window.names[0] == "ball"
    press("backspace")
    assert "ball" not in window.scene.regions
    assert "ball" not in {fact.subject for fact in window.scene.relations.holding()}
    press("backspace")
    press(" ")
    assert "ball" in window.scene.regions
    assert "ball is chosen" in figure.texts[0].get_text()


def test_where_there_is_no_window(tmp_path: Path) -> None:
    """It says so and writes pictures."""
    bare = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    run = subprocess.run(
        [sys.executable, SCRIPT, "--live", "--steps", "1", "-o", tmp_path / "new"],
        capture_output=True,
        text=True,
        env=bare | {"MPLBACKEND": "tkagg"},
        check=True,
    )
    assert run.stdout.startswith("no window can be opened here")
    assert "wedge on table begins" in run.stdout
    pictures = sorted((tmp_path / "new").iterdir())
    assert [path.name for path in pictures] == ["00.png", "01.png"]
    pixels = np.asarray(Image.open(pictures[1]).convert("RGB"))
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 50


def test_a_backend_without_windows(example: ModuleType) -> None:
    matplotlib.use("agg")
    assert not example.live()

import math

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from semmap.draw.labels import AROUND, Labels


def axes():
    figure = Figure(figsize=(4, 4), dpi=72)
    FigureCanvasAgg(figure)
    made = figure.add_axes((0, 0, 1, 1))
    made.set_xlim(0, 10)
    made.set_ylim(0, 10)
    return made


def overlaps(labels: Labels) -> bool:
    boxes = labels.taken
    return any(
        min(a[2], b[2]) - max(a[0], b[0]) > 1e-6 and min(a[3], b[3]) - max(a[1], b[1]) > 1e-6
        for i, a in enumerate(boxes)
        for b in boxes[i + 1 :]
    )


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.floats(0.5, 9.5), st.floats(0.5, 9.5)), max_size=25))
def test_texts_do_not_overlap(points):
    labels = Labels(axes())
    for i, (x, y) in enumerate(points):
        labels.put(x, y, f"name {i}", offsets=((0, 0), *AROUND), fontsize=8)
    assert not overlaps(labels)


def test_a_text_is_moved_left_out_or_forced():
    labels = Labels(axes())
    assert labels.put(5, 5, "first") is not None
    second = labels.put(5, 5, "second", offsets=((0, 0), (0, 40)))
    assert second is not None
    assert second.get_position() == (0, 40)
    assert labels.put(5, 5, "third") is None
    assert labels.put(5, 5, "third", most=math.inf) is not None


def test_a_text_fits_into_its_limits():
    labels = Labels(axes())
    assert labels.put(5, 5, "a long name", within=(0.5, 0.5), fontsize=8) is None
    assert labels.put(5, 5, "a long name", within=(8, 2), fontsize=8) is not None


def test_texts_avoid_points_and_boxes():
    labels = Labels(axes())
    labels.keep_clear(5, 5, 10)
    labels.shun([(4, 6, 6, 8)])
    text = labels.put(5, 5, "x", offsets=((0, 0), (0, 70), (0, -70)), fontsize=8)
    assert text is not None
    assert text.get_position() == (0, -70)
    assert np.isclose(labels.axes.get_xlim(), (0, 10)).all()


def test_of_many_texts_no_more_than_a_share_is_covered():
    labels, spots = Labels(axes()), np.random.default_rng(4).uniform(0, 10, (200, 2))
    for x, y in spots:
        labels.put(x, y, "gate 17", offsets=AROUND, most=0.1)
    boxes = [shapely.box(*box) for box in labels.taken]
    assert 20 < len(boxes) < 200, "some have no place"
    for k, box in enumerate(boxes):
        covered = sum(box.intersection(other).area for other in boxes[:k])
        assert covered <= 0.1 * box.area + 1e-6

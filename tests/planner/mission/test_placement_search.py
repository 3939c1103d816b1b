"""Free spots, against shapely."""

from __future__ import annotations

import shapely
from hypothesis import given
from hypothesis import strategies as st

from planner.mission.placement_search import STEP, find_free_spot

numbers = st.floats(0, 2).map(lambda v: round(v, 3))


@given(st.lists(st.tuples(numbers, numbers), max_size=12), numbers, numbers, st.floats(0.02, 0.3))
def test_free_and_nearest(
    taken: list[tuple[float, float]], x: float, y: float, radius: float
) -> None:
    surface = shapely.box(0, 0, 2, 1)
    others = [shapely.Point(p).buffer(0.1) for p in taken]
    found = find_free_spot(surface, others, radius, (x, y))
    free = surface.buffer(-radius).difference(
        shapely.union_all([o.buffer(radius + 0.01) for o in others])
    )
    assert (found is None) == free.is_empty
    if found is not None:
        circle = shapely.Point(found).buffer(radius * 0.98)
        assert surface.covers(circle)
        assert not any(circle.intersects(o) for o in others)
        if free.buffer(-STEP).area > 0.1:  # no other is nearer by more than the steps
            nearest = free.buffer(-STEP).distance(shapely.Point(x, y))
            assert shapely.Point(found).distance(shapely.Point(x, y)) <= nearest + 2 * STEP


def test_full() -> None:
    assert find_free_spot(shapely.box(0, 0, 1, 1), [shapely.box(0, 0, 1, 1)], 0.1, (0, 0)) is None
    assert find_free_spot(shapely.box(0, 0, 0.1, 1), [], 0.1, (0, 0)) is None

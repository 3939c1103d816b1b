"""The same voxels and numbers by each kind of instructions that this processor has."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from semmap.fields import Cone, RegionMap, Sphere, voxels_of
from semmap_vdb import choose_variant, variants
from tests.oracles.region_map import check_region_map


@pytest.fixture
def _restored() -> Iterator[None]:
    yield
    choose_variant(variants()[-1])


@pytest.mark.usefixtures("_restored")
def test_all_variants_have_equal_results() -> None:
    """Rasterised, put in, moved, taken out and looked up."""
    random = np.random.default_rng(6)
    spheres = [Sphere(random.uniform(-20, 20, 3), random.uniform(1, 14)) for _ in range(20)]
    cones = [Cone(random.uniform(-9, 9, 3), random.normal(size=3), 0.5, 15) for _ in range(5)]
    points = random.uniform(-40, 40, (10_000, 3))
    answers = []
    for name in variants():
        choose_variant(name)
        here = RegionMap(0.5, threads=2)
        for i, ball in enumerate(spheres):
            here.insert(i, ball)
        here.insert_many(enumerate(cones, start=15))
        here.move(3, spheres[4])
        here.remove(7)
        check_region_map(here._native)
        voxels = np.concatenate([voxels_of(region, 0.5) for region in (*spheres, *cones)])
        answers.append((here.set_numbers_at(points), voxels))
    for numbers, voxels in answers:
        assert (numbers == answers[0][0]).all()
        assert (voxels == answers[0][1]).all()
    assert len(np.unique(answers[0][0])) > 20


def test_an_unknown_variant_is_refused() -> None:
    """One that this processor lacks is refused."""
    with pytest.raises(ValueError, match="has no variant"):
        choose_variant("abacus")

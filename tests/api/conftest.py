"""Maps of other tests on which the methods of the API are tried."""

from tests.belief.conftest import flat_map
from tests.manipulation.cup_map import cup_map, cups
from tests.manipulation.house_map import house, house_map

__all__ = ["cup_map", "cups", "flat_map", "house", "house_map"]

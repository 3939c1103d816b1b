"""The fields of the map that the user chose."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache

from semmap import cli
from semmap.api.spatial_fields import SpatialFields
from semmap.fields.service.client import ServiceAddress


@contextmanager
def chosen_fields(map_name: str | None, voxel_size: float = 0.05) -> Iterator[SpatialFields]:
    """The fields of the chosen map; its database is opened where no service answers."""
    with ExitStack() as stack:
        yield SpatialFields(
            ServiceAddress(cli.chosen_url(), map_name),
            cache(lambda: stack.enter_context(cli.chosen_map(map_name))),
            voxel_size,
            _note,
        )


def _note(text: str) -> None:
    if text.startswith("left out: "):
        cli.err.print(text, style="yellow")
    else:
        print(text, file=sys.stderr)

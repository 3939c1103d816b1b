"""Python's garbage collector, which looks at all objects that are alive, pauses."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Pause it while thousands of objects are made that all stay alive, or in a short reply.

    It takes a tenth of the time of loading 1,000 rooms, and up to 0.1 s with 1,000 queries.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()

"""How much tests try: little in each run, more where `make explore` looks for what no run found."""

from __future__ import annotations

import os
from typing import TypeVar

EXPLORES = os.environ.get("HYPOTHESIS_PROFILE") == "explore"
"""Whether this run looks for new examples; tests with more cases then have the mark `explore`."""

T = TypeVar("T")


def effort(each_run: T, explore: T) -> T:
    """How much of something is tried: numbers of cases, or the cases."""
    return explore if EXPLORES else each_run

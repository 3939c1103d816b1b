"""The names of types from the names that other systems give their classes."""

from __future__ import annotations

import re


def snake_case(local_name: str) -> str:
    """Return the name of a type from the local name of its class.

    >>> snake_case("DiningTable"), snake_case("TVCabinet"), snake_case("coffee-mug")
    ('dining_table', 'tv_cabinet', 'coffee_mug')
    """
    split = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", local_name)
    return re.sub(r"\W+|_+", "_", split).strip("_").lower()

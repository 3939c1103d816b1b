"""The names of types from the names that other systems give their classes."""

from __future__ import annotations

import re


def local_name(iri: str) -> str:
    """Return an IRI without its namespace: what follows the last of # / and :."""
    return re.split(r"[#/:]", iri)[-1]


def namespace_of(iri: str) -> str:
    """Return an IRI without its local name."""
    return iri[: len(iri) - len(local_name(iri))]


def snake_case(name: str) -> str:
    """Return the name of a type from the local name of its class.

    >>> snake_case("DiningTable"), snake_case("TVCabinet"), snake_case("coffee-mug")
    ('dining_table', 'tv_cabinet', 'coffee_mug')
    """
    split = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name)
    return re.sub(r"\W+|_+", "_", split).strip("_").lower()

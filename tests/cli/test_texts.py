"""Values of options from their texts."""

from __future__ import annotations

import pytest

from semmap.cli.texts import numbers


def test_numbers_are_returned_in_order() -> None:
    assert numbers("1,-2.5, 3e2", "--near X,Y,Z", 3) == (1.0, -2.5, 300.0)


@pytest.mark.parametrize("text", ["", "1", "1,2,3", "1,x", "1,nan", "inf,1"])
def test_other_texts_are_refused_with_the_name_of_the_option(text: str) -> None:
    with pytest.raises(ValueError, match="--size W,H takes 2 numbers"):
        numbers(text, "--size W,H", 2)

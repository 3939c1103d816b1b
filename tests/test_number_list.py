"""Numbers with commas between them, as options take them."""

from __future__ import annotations

import pytest

from semmap.number_list import parse_numbers


def test_numbers_are_returned_in_order() -> None:
    assert parse_numbers("1,-2.5, 3e2", 3, "--near X,Y,Z") == (1.0, -2.5, 300.0)


@pytest.mark.parametrize("text", ["", "1", "1,2,3", "1,x", "1,nan", "inf,1"])
def test_other_texts_are_refused_with_the_name_of_the_option(text: str) -> None:
    with pytest.raises(ValueError, match="--size W,H takes 2 numbers"):
        parse_numbers(text, 2, "--size W,H")

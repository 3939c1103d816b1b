"""No call of a native function ends the process, whatever it is given."""

from __future__ import annotations

from itertools import chain

import pytest

from tests.native.arguments import Call, native_calls, vdb_calls
from tests.native.shape_arguments import shape_calls

CALLS = dict(chain(native_calls(), shape_calls(), vdb_calls()))


@pytest.mark.parametrize("name", CALLS)
def test_wrong_arguments_are_refused(name: str) -> None:
    call: Call = CALLS[name]
    with pytest.raises((ValueError, TypeError, OSError)) as refused:
        call()
    assert str(refused.value)

"""A worker reports each way in which a case can end, and goes on with the next case."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.fuzz.languages import LANGUAGE_KINDS
from tests.fuzz.pool import Worker, encoded


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    made = Worker("tests.fuzz.self_test", seconds=1, memory=2**28)
    yield made
    made.close()


@pytest.mark.parametrize(
    ("data", "outcome", "text"),
    [
        (b"accept", "accepted", ""),
        (b"refuse", "refused", "this input is refused"),
        (b"refuse silently", "unexpected", "without a text"),
        (b"fail", "unexpected", "KeyError: 'missing'"),
        (b"sleep", "hang", "self_test.py"),
        (b"compute", "hang", "self_test.py"),
        (b"allocate", "memory", ""),
        (b"allocate too much", "memory", ""),
        (b"abort", "crash", "Aborted"),
    ],
)
def test_a_worker_reports_how_a_case_ends(
    worker: Worker, data: bytes, outcome: str, text: str
) -> None:
    result = worker.run({"kind": "self test", "data": encoded(data)})
    assert (result.outcome, result.data) == (outcome, data)
    assert text in result.text
    assert result.is_finding == (outcome not in ("accepted", "refused"))
    after = worker.run({"kind": "self test", "data": encoded(b"accept")})
    assert after.outcome == "accepted"


def test_a_number_and_a_seed_make_the_same_case() -> None:
    (kind,) = (k for k in LANGUAGE_KINDS if k.name == "goal")
    assert kind.case(3, "1") == kind.case(3, "1")
    assert len({kind.case(n, "1") for n in range(20)}) > 10
    assert kind.case(3, "1") != kind.case(3, "2")

"""What fuzzing found stays fixed: each kept case is accepted or refused, in time and memory."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.conftest import MakeDatabase
from tests.fuzz.answers import ANSWER_KINDS
from tests.fuzz.bombs import BOMB_KINDS
from tests.fuzz.cases import Case, kept
from tests.fuzz.files import FILE_KINDS
from tests.fuzz.kind import SERVER, Kind
from tests.fuzz.knowledge_files import KNOWLEDGE_FILE_KINDS
from tests.fuzz.languages import LANGUAGE_KINDS
from tests.fuzz.pool import Worker, encoded
from tests.fuzz.server import close, prepare
from tests.fuzz.stored_knowledge import STORED_KINDS


@pytest.fixture(scope="module", autouse=True)
def server(make_database: MakeDatabase) -> Iterator[None]:
    url = make_database().render_as_string(hide_password=False)
    prepare(url)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(SERVER, url)
        yield
        close()


@pytest.fixture(scope="module")
def worker(server: None) -> Iterator[Worker]:
    made = Worker()
    yield made
    made.close()


@pytest.mark.parametrize("case", [*kept()], ids=lambda case: case.name)
def test_a_kept_case_ends_well(worker: Worker, case: Case) -> None:
    result = worker.run({"kind": case.kind, "data": encoded(case.data)})
    assert not result.is_finding, f"{result.outcome}: {result.text}"
    assert case.expected in (None, result.outcome), result.text


@pytest.mark.parametrize(
    "kind",
    [
        *FILE_KINDS,
        *KNOWLEDGE_FILE_KINDS,
        *LANGUAGE_KINDS,
        *STORED_KINDS,
        *ANSWER_KINDS,
        *BOMB_KINDS,
    ],
    ids=lambda kind: kind.name,
)
def test_a_valid_input_of_each_kind_is_accepted(worker: Worker, kind: Kind) -> None:
    result = worker.run({"kind": kind.name, "data": encoded(kind.seeds[0])})
    assert result.outcome == "accepted", f"{result.outcome}: {result.text}"

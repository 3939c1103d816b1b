"""All that is fuzzed."""

from __future__ import annotations

from tests.fuzz.answers import ANSWER_KINDS
from tests.fuzz.bombs import BOMB_KINDS
from tests.fuzz.files import FILE_KINDS
from tests.fuzz.kind import Kind
from tests.fuzz.knowledge_files import KNOWLEDGE_FILE_KINDS
from tests.fuzz.languages import LANGUAGE_KINDS
from tests.fuzz.native import NATIVE_KINDS
from tests.fuzz.requests import REQUEST_KINDS
from tests.fuzz.stored_knowledge import STORED_KINDS

_ALL = (
    *FILE_KINDS,
    *KNOWLEDGE_FILE_KINDS,
    *LANGUAGE_KINDS,
    *STORED_KINDS,
    *ANSWER_KINDS,
    *BOMB_KINDS,
    *REQUEST_KINDS,
    *NATIVE_KINDS,
)
KINDS: dict[str, Kind] = {kind.name: kind for kind in _ALL}

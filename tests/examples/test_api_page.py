"""The Python examples of docs/api.md and of the README print what the pages show."""

import doctest
import re
from pathlib import Path

import pytest

from semmap.database import open_engine
from semmap.ingest.importer import import_file

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", ["docs/api.md", "README.md"])
def test_page_shows_what_python_prints(
    page: str, database: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine = open_engine(database)
    for name in ("office.sdf", "office_rooms.geojson"):
        import_file(engine, ROOT / "examples/office" / name, map_name="office")
    engine.dispose()
    monkeypatch.setenv("SEMMAP_DB", database)
    monkeypatch.chdir(ROOT)
    blocks = BLOCK.findall((ROOT / page).read_text())
    examples = "\n".join(block for block in blocks if block.startswith(">>>"))
    test = doctest.DocTestParser().get_doctest(examples, {}, page, page, 0)
    options = doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL
    found = doctest.DocTestRunner(optionflags=options).run(test)
    assert found.attempted > 5
    assert found.failed == 0

"""The client of docs/tools.md finds a cup, and the way to it."""

import os
import subprocess
import sys
from pathlib import Path

from sqlalchemy import Engine

from tests.examples.test_api_page import BLOCK, ROOT


def test_the_client_of_the_page_gets_answers(office_world: Engine) -> None:
    (example,) = BLOCK.findall((ROOT / "docs/tools.md").read_text())
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    url = office_world.url.render_as_string(hide_password=False)
    told = subprocess.run(
        [sys.executable, "-c", example],
        env=os.environ | {"SEMMAP_DB": url, "PATH": programs},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert told.returncode == 0, told.stderr
    assert "cup" in told.stdout
    assert float(told.stdout.split()[-1]) > 0

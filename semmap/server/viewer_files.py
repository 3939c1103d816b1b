"""The pages of the viewer and of queries, which `scripts/setup viewer` builds from `viewer/`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from starlette.responses import Response
from starlette.staticfiles import StaticFiles

FOLDER = Path(__file__).parent / "viewer"

GRIPS = "'sha256-zCK2EVMoPc04mRF/g5CotUvxbJPWS+8V0b+s9ptqQIk='"
"""The style of the grips of columns, which YASGUI's tables add to the page."""

POLICY = "; ".join(
    (
        "default-src 'self'",
        f"style-src 'self' {GRIPS}",
        "img-src 'self' blob: data:",
        "connect-src 'self' blob:",
        "object-src 'none'",
        "base-uri 'none'",
        "frame-ancestors 'none'",
    )
)
"""What a page may load: nothing from elsewhere, no script that its files do not have."""


def viewer_is_built() -> bool:
    """Whether the page is there; in a checkout, `scripts/setup viewer` builds it."""
    return (FOLDER / "index.html").is_file()


class Viewer(StaticFiles):
    """The files of the pages, which need no rights: their requests have those of their token."""

    def __init__(self) -> None:
        super().__init__(directory=FOLDER, html=True, check_dir=False)

    def file_response(self, full_path: str | os.PathLike[str], *args: Any, **kw: Any) -> Response:
        """A file, with the policy that holds for the page."""
        response = super().file_response(full_path, *args, **kw)
        response.headers["Content-Security-Policy"] = POLICY
        response.headers["X-Content-Type-Options"] = "nosniff"
        return response

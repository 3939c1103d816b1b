"""A picture that a notebook shows and a file keeps."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Self


@dataclass(frozen=True)
class Picture:
    """A PNG."""

    png: bytes = field(repr=False)

    @classmethod
    def drawn(cls, draw: Callable[[Path], object]) -> Self:
        """Return what a function draws into the file that it is given; a $ in a name is one."""
        import matplotlib

        with TemporaryDirectory(prefix="semmap-") as folder:
            path = Path(folder, "picture.png")
            with matplotlib.rc_context({"text.parse_math": False}):
                draw(path)
            return cls(path.read_bytes())

    @classmethod
    def stacked(cls, pictures: Iterable[Picture]) -> Self:
        """Return pictures one below another, each as wide as the widest."""
        from PIL import Image

        images = [Image.open(BytesIO(picture.png)).convert("RGB") for picture in pictures]
        width = max(image.width for image in images)
        whole = Image.new("RGB", (width, sum(image.height for image in images)), "white")
        top = 0
        for image in images:
            whole.paste(image, (0, top))
            top += image.height
        file = BytesIO()
        whole.save(file, "PNG")
        return cls(file.getvalue())

    def save(self, path: Path | str) -> Path:
        """Write it as a PNG file; return its path."""
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(self.png)
        return path

    def __repr__(self) -> str:
        width, height = (int.from_bytes(self.png[at : at + 4]) for at in (16, 20))  # of its header
        return f"<picture of {width} x {height} pixels>"

    def _repr_png_(self) -> bytes:
        return self.png

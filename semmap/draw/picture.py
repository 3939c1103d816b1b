"""A picture that a notebook shows and a file keeps."""

from __future__ import annotations

import re
import threading
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from semmap.garbage import give_back_memory
from semmap.temporary_folder import temporary_folder
from semmap.whole_file import whole_file, write_whole

DRAWN = (".svg", ".pdf")
"""Files into which a picture is drawn again, as lines."""

OTHER_FONTS = ("Noto Sans", "WenQuanYi", "IPA", "Droid Sans Fallback")
"""How the names of fonts begin that have letters of more languages."""

_MISSING = re.compile(r"Glyph (\d+) .*missing from font")

_SETTINGS = threading.Lock()
"""Settings of matplotlib, and filters of warnings, are those of the process."""

SVG = "http://www.w3.org/2000/svg"


@dataclass(frozen=True)
class Picture:
    """A PNG, and the function that draws it into another file; pixels only without it.

    `notes` say what it assumes, and what it does not show.
    """

    png: bytes = field(repr=False)
    draw: Callable[[Path], object] | None = field(default=None, repr=False, compare=False)
    notes: tuple[str, ...] = field(default=(), repr=False, compare=False)

    @classmethod
    def drawn(cls, draw: Callable[[Path], object], *notes: str) -> Picture:
        """Return what a function draws into the file that it is given; a $ in a name is one."""
        import matplotlib
        from matplotlib.font_manager import fontManager

        installed = {font.name for font in fontManager.ttflist}
        fonts = ["DejaVu Sans", *sorted(name for name in installed if name.startswith(OTHER_FONTS))]
        unknown: set[str] = set()

        def drawn(path: Path) -> bytes:
            settings: Any = {"text.parse_math": False, "font.family": fonts}
            with (
                _SETTINGS,
                matplotlib.rc_context(settings),
                warnings.catch_warnings(record=True) as told,
            ):
                warnings.simplefilter("always")
                draw(path)
            for each in told:
                glyph = _MISSING.match(str(each.message))
                if glyph:
                    unknown.add(chr(int(glyph[1])))
                else:
                    warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
            return path.read_bytes()

        with temporary_folder() as folder:
            png = drawn(folder / "picture.png")
        give_back_memory()
        if unknown:
            letters = "".join(sorted(unknown))
            notes += (
                f"no font here has {letters}: boxes stand for them. Debian: fonts-noto-core, "
                "fonts-noto-cjk",
            )
        return cls(png, drawn, notes)

    @classmethod
    def stacked(cls, pictures: Iterable[Picture]) -> Picture:
        """Return pictures one below another, each as wide as the widest."""
        from PIL import Image

        pages = [*pictures]
        if len(pages) == 1:
            return pages[0]
        images = [Image.open(BytesIO(picture.png)).convert("RGB") for picture in pages]
        width = max(image.width for image in images)
        whole = Image.new("RGB", (width, sum(image.height for image in images)), "white")
        top = 0
        for image in images:
            whole.paste(image, (0, top))
            top += image.height
        file = BytesIO()
        whole.save(file, "PNG")
        notes = tuple(dict.fromkeys(note for page in pages for note in page.notes))
        return cls(file.getvalue(), lambda path: _stack(pages, path), notes)

    def save(self, path: Path | str) -> Path:
        """Write it as a PNG, SVG or PDF file, by the end of its name; return its path.

        ValueError: another end, or PDF for a picture of several storeys.
        """
        path = Path(path)
        end = path.suffix.lower()
        if end not in (".png", *DRAWN):
            raise ValueError(f"{path}: a picture is a .png, .svg or .pdf file")
        if end in DRAWN and self.draw is None:
            raise ValueError(f"{path}: this picture is pixels alone: save it as .png")
        path.parent.mkdir(parents=True, exist_ok=True)
        if end in DRAWN and self.draw is not None:
            with whole_file(path) as made:
                self.draw(made)
        else:
            write_whole(path, self.png)
        return path

    def __repr__(self) -> str:
        width, height = (int.from_bytes(self.png[at : at + 4]) for at in (16, 20))  # of its header
        return f"<picture of {width} x {height} pixels>"

    def _repr_png_(self) -> bytes:
        return self.png


def _stack(pictures: Iterable[Picture], path: Path) -> None:
    """Write pictures one below another into an SVG file."""
    if path.suffix.lower() != ".svg":
        raise ValueError(f"{path}: several storeys are one .png or .svg file: choose one for .pdf")
    ElementTree.register_namespace("", SVG)
    ElementTree.register_namespace("xlink", "http://www.w3.org/1999/xlink")
    whole = ElementTree.Element(f"{{{SVG}}}svg")
    right = bottom = 0.0
    with temporary_folder() as folder:
        for picture in pictures:
            page = ElementTree.parse(picture.save(folder / "page.svg")).getroot()
            _, _, width, height = (float(number) for number in page.attrib["viewBox"].split())
            page.attrib |= {"y": f"{bottom:g}", "width": f"{width:g}", "height": f"{height:g}"}
            whole.append(page)
            right, bottom = max(right, width), bottom + height
    whole.attrib |= {"width": f"{right:g}pt", "height": f"{bottom:g}pt", "version": "1.1"}
    whole.attrib["viewBox"] = f"0 0 {right:g} {bottom:g}"
    ElementTree.ElementTree(whole).write(path, "utf-8", xml_declaration=True)

"""The command line `semmap`, and what commands of other packages share with it.

Each name is loaded from its module when it is first used, so that a short command starts quickly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from semmap.cli.application import app, main, print_summary
    from semmap.cli.chosen import chosen_map, chosen_url, open_database
    from semmap.cli.options import Json, MapName
    from semmap.cli.output import err, out, print_json, show_rows, show_table

__all__ = [
    "Json",
    "MapName",
    "app",
    "chosen_map",
    "chosen_url",
    "err",
    "main",
    "open_database",
    "out",
    "print_json",
    "print_summary",
    "show_rows",
    "show_table",
]

_HOMES = {
    "application": ("app", "main", "print_summary"),
    "chosen": ("chosen_map", "chosen_url", "open_database"),
    "options": ("Json", "MapName"),
    "output": ("err", "out", "print_json", "show_rows", "show_table"),
}

__getattr__ = load_on_use(
    __name__,
    {name: f"semmap.cli.{module}" for module, names in _HOMES.items() for name in names},
)

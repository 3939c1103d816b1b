"""The command line `semmap`, and what commands of other packages share with it.

Each name is loaded from its module when it is first used, so that a short command starts quickly.
"""

from typing import TYPE_CHECKING

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from semmap.cli.application import app as app
    from semmap.cli.application import main as main
    from semmap.cli.chosen import chosen_map as chosen_map
    from semmap.cli.chosen import chosen_url as chosen_url
    from semmap.cli.chosen import open_database as open_database
    from semmap.cli.imports import print_summary as print_summary
    from semmap.cli.options import Json as Json
    from semmap.cli.options import MapName as MapName
    from semmap.cli.output import err as err
    from semmap.cli.output import out as out
    from semmap.cli.output import print_json as print_json
    from semmap.cli.output import show_rows as show_rows
    from semmap.cli.output import show_table as show_table

__getattr__, __all__ = load_on_use(__name__)

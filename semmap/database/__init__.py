"""The database: by URL, or the user's own embedded cluster; its schema brought up to date."""

from typing import TYPE_CHECKING

from semmap.database.embedded import Cluster
from semmap.database.error import DatabaseError
from semmap.database.session import open_session
from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from semmap.database.engine import database_url, open_engine
    from semmap.database.reading_login import as_reader

__all__ = ["Cluster", "DatabaseError", "as_reader", "database_url", "open_engine", "open_session"]

__getattr__, _ = load_on_use(__name__)

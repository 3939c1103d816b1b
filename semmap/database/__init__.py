"""The database: by URL, or the user's own embedded cluster; its schema brought up to date."""

from semmap.database.embedded import Cluster
from semmap.database.engine import connect, database_url
from semmap.database.error import DatabaseError
from semmap.database.reader import as_reader

__all__ = ["Cluster", "DatabaseError", "as_reader", "connect", "database_url"]

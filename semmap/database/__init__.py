"""The database: by URL, or the user's own embedded cluster; its schema brought up to date."""

from semmap.database.embedded import Cluster
from semmap.database.engine import connect, database_url
from semmap.database.error import DatabaseError

__all__ = ["Cluster", "DatabaseError", "connect", "database_url"]

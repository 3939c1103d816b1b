"""The error of this package: what is wrong with a database, and what to do."""

from semmap.error import Error


class DatabaseError(Error):
    """A database that cannot be had or used; the message says what to do."""

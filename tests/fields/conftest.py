"""The clusters of a test's own that those of the database have."""

from tests.database.conftest import made, own

__all__ = ["made", "own"]

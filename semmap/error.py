"""The base of the errors that a user of semmap can act on."""

from __future__ import annotations


class Error(Exception):
    """Something that was given cannot be used; the message says what is wrong and how to fix it.

    The classes below it are a ValueError or a LookupError, too, where that fits.
    """

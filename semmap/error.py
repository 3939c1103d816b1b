"""The base of the errors that a user of semmap can act on, and those of names and arguments."""


class Error(Exception):
    """Something that was given cannot be used; the message says what is wrong and how to fix it.

    The classes below it are a ValueError or a LookupError, too, where that fits.
    """


class UnknownNameError(Error, LookupError):
    """A map, entity, type or class of robots that is not there; the message names similar ones."""


class InvalidArgumentError(Error, ValueError):
    """An argument that is not valid, or a change that breaks a rule of the map."""


class RightsError(Error, PermissionError):
    """The role of the login may not do it."""

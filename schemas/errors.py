"""Errors of the schemas package: one base class, each error carries its data."""

from __future__ import annotations


class SchemaError(ValueError):
    """A bus message or a file does not follow its format.

    Attributes:
        field: path of the offending field, such as ``q[3]`` or
            ``platform[0].motion[1].axis``; empty when no single field is at fault.
    """

    def __init__(self, message: str, *, field: str = "") -> None:
        """Keep the path of the offending field beside the message."""
        super().__init__(message)
        self.field = field


class MessageError(SchemaError):
    """A bus message is malformed: shape, type, size or value."""


class SchemaVersionError(MessageError):
    """A bus message was written for another schema version."""


class FileFormatError(SchemaError):
    """A user's file cannot be used; the message names file and key."""

"""Reads and writes recorded data, in the data types of `saccade.types` and `saccade.frames`.

A missing, broken or unexpected file raises a subclass of `SaccadeError`: `LogError` for logs,
tables and fixations, `DriveError` for drives, `ImageError` for images. The message is one line with
the file, the line or row, the expected content and the found content. All writers raise
`OutputError`, and `ConfigError` for an unknown suffix.

The names are loaded when they are first used.
"""

from saccade.lazy import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)

"""Camera drives, one file per layout.

Readers raise `DriveError` or `LogError`, one line that names the file, what was expected and what
was found; loading a frame raises `ImageError`.
"""

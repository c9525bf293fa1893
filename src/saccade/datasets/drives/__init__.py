"""Camera drives, one file per layout.

Loading a frame raises `ImageError`; reading a drive raises `DriveError` or `LogError`.
"""

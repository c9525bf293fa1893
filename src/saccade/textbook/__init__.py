"""The source's algorithms as it prints them: one file beside each appendix, slow and readable."""

from saccade.textbook.sift import sift

__all__ = ["sift"]

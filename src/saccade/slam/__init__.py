"""Range-bearing landmark SLAM; independent of images.

The names are loaded when they are first used, so that a table of this package can be read without
the filter.
"""

from saccade.lazy import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)

"""The three systems equation by equation, to be read beside their source.

Each file implements one appendix of G. W. Kootstra, *Visual attention and active vision: from
natural to artificial systems* (PhD thesis, University of Groningen, 2010): plain NumPy and SciPy,
the steps, symbols and equation numbers of the source, every intermediate result returned. Choices
that the source leaves open are constants at the top of the file, or are noted in place. Copy a
file, change an equation, and run it.

The rest of `saccade` is faster and more general, and is tested against these files.
"""

from saccade.textbook.contrast_saliency import contrast_saliency
from saccade.textbook.ekf_slam import EkfSlam
from saccade.textbook.pop_out import pop_out_display, target_rank
from saccade.textbook.sift import sift

__all__ = [
    "EkfSlam",
    "contrast_saliency",
    "pop_out_display",
    "sift",
    "target_rank",
]

"""Fixations in tables, recordings and exports of eye trackers, and MATLAB files."""

from saccade.datasets.fixations.formats import FORMATS as FORMATS
from saccade.datasets.fixations.reading import FixationFormat as FixationFormat
from saccade.datasets.fixations.reading import read_fixations as read_fixations
from saccade.datasets.fixations.reading import write_fixations as write_fixations

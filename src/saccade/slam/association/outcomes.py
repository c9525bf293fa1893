"""Outcomes of the association of an observation with no landmark, in place of a landmark's id."""

NEW = -1
"""No landmark of the map is near the observation: it may become one."""
DROPPED = -2
"""Ambiguous: near a landmark, but outside its gate, or not near that one alone."""
UNDECIDED = -3
"""To be associated by geometry."""
UNUSED = -4
"""A partial observation of no landmark of the map, which cannot add one; in the search of a pose,
an observation with a label of no landmark."""

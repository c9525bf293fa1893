"""Recorded data, each source read into the nouns of `saccade.types`."""

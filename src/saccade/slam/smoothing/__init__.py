"""Smoothing of a whole log, or with a fixed lag."""

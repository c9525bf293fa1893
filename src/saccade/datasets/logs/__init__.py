"""Landmark logs, one file per format."""

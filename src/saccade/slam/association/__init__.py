"""Data association."""

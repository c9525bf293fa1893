"""Walkthrough of the textbook: each equation beside its code, with figures of your own data."""

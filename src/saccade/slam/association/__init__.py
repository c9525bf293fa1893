"""Data association: which landmark each observation is of."""

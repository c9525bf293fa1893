"""The filters: the state, and its prediction, update and augmentation."""

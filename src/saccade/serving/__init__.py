"""A local page: a photograph is dropped on it, and what is found in it is shown."""

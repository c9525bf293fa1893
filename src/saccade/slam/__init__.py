"""Where things are: range-bearing landmark SLAM; it never sees an image."""

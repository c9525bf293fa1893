"""Camera drives, one file per layout."""

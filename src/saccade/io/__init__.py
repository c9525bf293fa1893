"""Images, films, cameras, files and checkpoints: what is read and written."""

"""Images, films, cameras and files: what is read and written."""

"""Reading and writing of images, videos, arrays and files."""

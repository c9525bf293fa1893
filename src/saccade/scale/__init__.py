"""Images at many scales: pyramids, scale spaces and sums over symmetric pairs."""

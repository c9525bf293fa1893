"""Which landmarks enter the map, and which are culled."""

"""A run as processes of its own that meet on the bus."""

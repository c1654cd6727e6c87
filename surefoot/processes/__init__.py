"""A run as separate processes that meet on the bus."""

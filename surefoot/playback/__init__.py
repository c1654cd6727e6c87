"""Records played again: on the bus, or through a controller."""

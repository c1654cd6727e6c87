"""Records played back: on the bus, or through the controller."""

"""What everyone else runs: the controller's client, observers, bus tools."""

"""The robot's clients: the controller's client, observers, bus tools."""

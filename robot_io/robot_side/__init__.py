"""The robot's side of the bus: server, command gate, mode machine, driver."""

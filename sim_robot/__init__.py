"""The simulated robot behind the bus: world, servos, sensors and moving ground."""

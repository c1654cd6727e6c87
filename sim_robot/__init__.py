"""The simulated robot: world, servos, sensors, moving ground, and what they measure."""

"""The controller: state from sensors, wanted wrenches, commanded joint velocities."""

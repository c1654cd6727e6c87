"""The controller: state from sensors, desired wrenches, commanded joint velocities."""

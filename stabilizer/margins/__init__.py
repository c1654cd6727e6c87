"""Stability margins of a robot's loops, computed before it stands."""

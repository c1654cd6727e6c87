"""Robot files: made from a URDF, and judged."""

"""What a robot can do standing on two feet, computed from its model alone."""

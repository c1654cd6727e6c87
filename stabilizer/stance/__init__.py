"""What a robot's body can do on its two feet, worked out from its model alone."""

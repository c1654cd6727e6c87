"""Records of a robot's bus in MCAP files: written, read, told about."""

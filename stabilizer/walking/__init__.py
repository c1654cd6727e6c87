"""Walking: from footsteps to references of both controllers."""

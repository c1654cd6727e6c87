"""Walking: footsteps to references; standing is a walk without steps."""

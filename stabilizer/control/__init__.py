"""The whole-body controller: tasks, both QPs, force feedback."""

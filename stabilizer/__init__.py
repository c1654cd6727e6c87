"""The stabilizer: snapshot -> observer -> both QPs -> joint positions, and its
process."""

"""The stabilizer: snapshot -> observer -> both QPs -> joint positions."""

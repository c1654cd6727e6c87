"""A relay between robot and stabilizer that does to the bus what a plan says."""

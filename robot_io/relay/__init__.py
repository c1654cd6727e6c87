"""A relay between robot and stabilizer that disturbs the bus as a plan says."""

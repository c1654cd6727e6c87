"""From a snapshot to the state the controllers work with."""

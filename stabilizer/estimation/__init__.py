"""The observer: from a snapshot to the state that controllers work with."""

"""Pages about runs that are over."""

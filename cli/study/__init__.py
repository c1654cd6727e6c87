"""Many runs: what to run, running it, keeping it, and what it amounts to."""

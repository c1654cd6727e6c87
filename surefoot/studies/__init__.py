"""Many runs: cells, execution, store, summaries, the paper's evaluation."""

"""Search of gains: parameters, trials, workers and outcome."""

"""Gains that are found by search: parameters, trials, workers, and what came out."""

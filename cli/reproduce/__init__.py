"""The paper's evaluation: what is run, what it must show, and the page about it."""

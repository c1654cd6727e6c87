"""The ``surefoot`` command: thin commands, all printing in one place."""

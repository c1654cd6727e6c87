"""Tools that listen to a robot's bus: ``topics``, ``echo``, ``hz``."""

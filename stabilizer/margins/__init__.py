"""How far a robot's loops are from swaying, told before it stands."""

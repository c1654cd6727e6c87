"""What any robot behind the bus must do, tried out on a live one."""

"""What a measurement file holds, and what looks wrong in it."""

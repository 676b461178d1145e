"""What looks wrong in a measurement."""

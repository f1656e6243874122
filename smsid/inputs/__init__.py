"""What drives a spacecraft: signals over time, and the inputs that are made of them."""

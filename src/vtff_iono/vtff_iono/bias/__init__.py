"""Code biases of satellites and receivers, and the density profiles estimated with them."""

"""Recording of every topic into a bag, counted message by message."""

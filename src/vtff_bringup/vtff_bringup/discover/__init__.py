"""What there is: installed files and nodes, parameters, topics, the version."""

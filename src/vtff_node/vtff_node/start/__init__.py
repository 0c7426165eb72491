"""Start of a node in its graph: the inputs that it waits for, the nodes that hear its topics."""

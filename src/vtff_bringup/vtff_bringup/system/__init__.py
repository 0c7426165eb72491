"""System files: the nodes of a graph, their parameters, wiring and composition."""

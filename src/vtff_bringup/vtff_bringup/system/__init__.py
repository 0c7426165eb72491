"""System files: which nodes a graph has, and how they are wired and composed."""

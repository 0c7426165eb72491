"""One run on several machines: its hosts, how its parts agree, and how its nodes find each other."""

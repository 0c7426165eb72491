"""One run on several machines: how its parts meet and agree, and how its nodes find each other."""

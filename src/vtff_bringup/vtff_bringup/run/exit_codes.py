"""Exit codes of the `vtff` command."""

from __future__ import annotations

EXIT_FAILURE = 1
#: A file, an argument or a parameter is wrong; also of a node that refuses its parameters.
EXIT_USAGE = 2
#: As a shell reports SIGINT.
EXIT_INTERRUPTED = 130

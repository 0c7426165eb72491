"""Exit codes of the `vtff` command."""

from __future__ import annotations

EXIT_FAILURE = 1
#: A file, an argument or a parameter is wrong, or a node refuses its parameters.
EXIT_USAGE = 2
#: Interrupted by Ctrl-C; the code with which a shell reports SIGINT.
EXIT_INTERRUPTED = 130

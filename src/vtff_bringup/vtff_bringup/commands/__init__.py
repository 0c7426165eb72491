"""The subcommands of `vtff`, one module each."""

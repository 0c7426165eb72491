"""System files, runner, launch files and the vtff command."""

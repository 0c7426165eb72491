"""System files, runner, recorder, reports and the vtff command."""

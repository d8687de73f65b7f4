"""One command a file; heavy modules are imported inside the commands, so that `--help` answers at once."""

"""Processes: the command line, sweeps, the machine."""

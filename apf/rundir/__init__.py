"""What is on disk: the run directory, its journal, tables, files and config."""

"""Reports of runs: figures, and summaries on the terminal."""

"""What is shown of runs: figures, summaries, the terminal."""

"""From run directories to tables and figures, e.g. `python analysis/plot_regret.py DIR`."""

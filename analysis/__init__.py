"""From run directories to tables and figures, e.g. `python -m analysis.plot_regret DIR`."""

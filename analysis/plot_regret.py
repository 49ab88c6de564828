"""Regret of one or many runs: median and quartiles over problems and runs, one panel for each task."""

from analysis.curves import Drawing, draw
from apf.report.figures import plot_regret, regret_curves

if __name__ == "__main__":
    draw("regret", __doc__, {"regret": Drawing(regret_curves, plot_regret)})

"""Accuracy of one or many runs: mean, least and greatest over runs, one panel for each length."""

from analysis.curves import draw
from apf.report.figures import accuracy_curves, plot_accuracy

if __name__ == "__main__":
    draw("accuracy", __doc__, accuracy_curves, plot_accuracy)

"""Accuracy of one or many runs, or another measure: mean, least and greatest over runs, one panel for each length.

python -m analysis.plot_accuracy runs/sweep --metric ece

The metrics are accuracy, auc (area under the ROC curve), nll (negative log-likelihood) and ece (expected calibration
error), as `apf.planning.measures` defines them. The CSV holds the means of all of them.
"""

from functools import partial

from analysis.curves import Drawing, draw
from apf.planning.measures import MEASURES
from apf.report.figures import accuracy_curves, plot_accuracy

if __name__ == "__main__":
    metrics = {
        name: Drawing(partial(accuracy_curves, metric=name), partial(plot_accuracy, metric=name)) for name in MEASURES
    }
    draw("accuracy", __doc__, metrics)

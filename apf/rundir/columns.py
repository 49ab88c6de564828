"""The columns of a run's tables, and their types."""

REGRET_COLUMNS = [
    *("step", "plans", "task", "problem", "world", "value", "chance", "best_value", "regret", "feasible"),
    *("search_value", "search_regret"),
]
ACCURACY_COLUMNS = ["step", "plans", "length", "accuracy", "auc", "nll", "ece", "n"]

DTYPES = {
    **dict.fromkeys(("step", "plans", "problem", "length", "n"), "int64"),
    **dict.fromkeys(("value", "chance", "best_value", "regret", "search_value", "search_regret"), "float64"),
    **dict.fromkeys(("accuracy", "auc", "nll", "ece"), "float64"),
    "feasible": "bool",
}
